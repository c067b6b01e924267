//! Nodes of cameras, and their names: `/dev/video0`, the links that udev makes by id and by path, the serial number and the
//! port of the USB device.

use std::fs;
use std::path::{Path, PathBuf};

use crate::source::usb::UsbDevice;

/// A node of a camera. A camera may have several: of its depth, its infrared, its colours, and of data about them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Node {
    /// Where it is.
    pub(super) path: PathBuf,
    /// What its driver calls it.
    pub(super) card: String,
    /// The USB device that it is of.
    pub(super) usb: Option<UsbDevice>,
    /// Links to it, below `v4l/by-id` and `v4l/by-path`.
    pub(super) links: Vec<PathBuf>,
}

/// All nodes, in the order of their numbers; `sys` and `dev` being `/sys` and `/dev`.
pub(super) fn nodes(sys: &Path, dev: &Path) -> Vec<Node> {
    let entries = fs::read_dir(sys.join("class/video4linux")).into_iter().flatten().flatten();
    let number = |name: &str| name.strip_prefix("video")?.parse::<u16>().ok();
    let numbered = entries.filter_map(|entry| {
        let number = number(entry.file_name().to_str()?)?;
        Some((number, entry.path()))
    });
    let mut folders: Vec<(u16, PathBuf)> = numbered.collect();
    folders.sort();
    let links = links(dev);
    let node = |(number, folder): (u16, PathBuf)| {
        let path = dev.join(format!("video{number}"));
        let card = fs::read(folder.join("name")).unwrap_or_default();
        // Its device is an interface of the USB device, or that itself.
        let device = fs::canonicalize(folder.join("device")).ok();
        let usb = device.and_then(|device| device.ancestors().take(2).find_map(UsbDevice::of_folder));
        let is_to_it = |link: &&PathBuf| fs::canonicalize(link).is_ok_and(|target| target == path);
        let links = links.iter().filter(is_to_it).cloned().collect();
        Node { card: String::from_utf8_lossy(&card).trim().to_owned(), usb, links, path }
    };
    folders.into_iter().map(node).collect()
}

fn links(dev: &Path) -> Vec<PathBuf> {
    let folders = ["v4l/by-id", "v4l/by-path"].map(|folder| fs::read_dir(dev.join(folder)));
    let mut links: Vec<PathBuf> =
        folders.into_iter().flatten().flatten().flatten().map(|entry| entry.path()).collect();
    links.sort();
    links
}

impl Node {
    /// Whether `wanted` names it: its path or that of any link to it, the name of udev's link, or the serial number or the
    /// port of its USB device.
    pub(super) fn is_named(&self, wanted: &str) -> bool {
        if wanted.contains('/') {
            return fs::canonicalize(wanted).is_ok_and(|target| target == self.path);
        }
        let by_link = self.links.iter().any(|link| link.file_name().is_some_and(|name| name == wanted));
        let by_usb = |usb: &UsbDevice| usb.port == wanted || usb.serial.as_deref() == Some(wanted);
        by_link
            || self.path.file_name().is_some_and(|name| name == wanted)
            || self.usb.as_ref().is_some_and(by_usb)
    }

    /// Vendor and model, as far as they are known.
    pub(super) fn vendor_and_model(&self) -> (String, String) {
        let usb = self.usb.as_ref();
        let vendor = usb.map_or_else(String::new, |usb| usb.manufacturer.clone());
        let model = usb.map(|usb| usb.product.clone()).filter(|product| !product.is_empty());
        (vendor, model.unwrap_or_else(|| self.card.clone()))
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;
    use crate::source::usb::tests::plug;

    /// A node of the interface of a USB device at `port`, as the kernel and udev show it.
    fn add(root: &Path, number: u16, port: &str, link: &str) {
        let (sys, dev) = (root.join("sys"), root.join("dev"));
        let interface = sys.join("bus/usb/devices").join(port).join(format!("{port}:1.{number}"));
        let folder = sys.join("class/video4linux").join(format!("video{number}"));
        fs::create_dir_all(&interface).expect("room");
        fs::create_dir_all(&folder).expect("room");
        fs::create_dir_all(dev.join("v4l/by-id")).expect("room");
        fs::write(folder.join("name"), "Depth: Depth\n").expect("room");
        symlink(interface, folder.join("device")).expect("room");
        let node = dev.join(format!("video{number}"));
        fs::write(&node, "").expect("room");
        symlink(node, dev.join("v4l/by-id").join(link)).expect("room");
    }

    #[test]
    fn a_node_has_its_usb_device_and_all_its_names() {
        let root = tempfile::tempdir().expect("a folder");
        let root = fs::canonicalize(root.path()).expect("it is there");
        let (sys, dev) = (root.join("sys"), root.join("dev"));
        assert_eq!(nodes(&sys, &dev), []);
        plug(&sys, "1-2", "8086:0b07", Some("A1"));
        plug(&sys, "1-3", "8086:0b07", Some("B2"));
        add(&root, 10, "1-3", "usb-Maker_B2-video-index0");
        add(&root, 2, "1-2", "usb-Maker_A1-video-index0");
        fs::create_dir(sys.join("class/video4linux/v4l-subdev0")).expect("room");
        let found = nodes(&sys, &dev);
        let ports: Vec<&str> = found.iter().map(|node| &*node.usb.as_ref().expect("USB").port).collect();
        assert_eq!(ports, ["1-2", "1-3"], "in the order of their numbers");
        assert_eq!(found[0].vendor_and_model(), ("Maker".to_owned(), "Depth Camera".to_owned()));

        symlink(dev.join("video2"), dev.join("mine")).expect("room");
        let own = dev.join("mine").display().to_string();
        let node = dev.join("video2").display().to_string();
        for name in ["A1", "1-2", "video2", "usb-Maker_A1-video-index0", &own, &node] {
            assert!(found[0].is_named(name) && !found[1].is_named(name), "{name}");
        }
        for name in ["A", "1", "", "/dev/null", "video"] {
            assert!(!found.iter().any(|node| node.is_named(name)), "{name:?}");
        }
    }
}
