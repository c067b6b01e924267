//! USB devices as the kernel shows them in its `/sys`.

use std::fs;
use std::path::{Path, PathBuf};

/// A USB device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct UsbDevice {
    /// Vendor and product.
    pub(super) id: (u16, u16),
    /// Its serial number, if it tells one.
    pub(super) serial: Option<String>,
    /// Its maker's name for himself; may be empty.
    pub(super) manufacturer: String,
    /// Its maker's name for it; may be empty.
    pub(super) product: String,
    /// Where it is plugged in, such as `1-2.4`: bus, port, and ports of hubs.
    pub(super) port: String,
    /// Its node, below `/dev`.
    pub(super) node: PathBuf,
}

impl UsbDevice {
    /// The device whose folder in `/sys` this is.
    pub(super) fn of_folder(folder: &Path) -> Option<Self> {
        let said = |name: &str| {
            let text = fs::read(folder.join(name)).ok()?;
            Some(String::from_utf8_lossy(&text).trim().to_owned()).filter(|text| !text.is_empty())
        };
        let hexadecimal = |name| u16::from_str_radix(&said(name)?, 16).ok();
        let number = |name| said(name)?.parse::<u16>().ok();
        let (bus, device) = (number("busnum")?, number("devnum")?);
        Some(Self {
            id: (hexadecimal("idVendor")?, hexadecimal("idProduct")?),
            serial: said("serial"),
            manufacturer: said("manufacturer").unwrap_or_default(),
            product: said("product").unwrap_or_default(),
            port: folder.file_name()?.to_str()?.to_owned(),
            node: format!("bus/usb/{bus:03}/{device:03}").into(),
        })
    }

    /// All that are plugged in, `sys` being `/sys`.
    pub(super) fn all(sys: &Path) -> Vec<Self> {
        let entries = fs::read_dir(sys.join("bus/usb/devices")).into_iter().flatten().flatten();
        let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        folders.sort();
        folders.iter().filter_map(|folder| Self::of_folder(folder)).collect()
    }

    /// Vendor and product, hexadecimal.
    pub(super) fn id_text(&self) -> String {
        format!("{:04x}:{:04x}", self.id.0, self.id.1)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Makes the folder of a device below `sys`, as the kernel does.
    pub(in super::super) fn plug(sys: &Path, port: &str, id: &str, serial: Option<&str>) -> PathBuf {
        let folder = sys.join("bus/usb/devices").join(port);
        fs::create_dir_all(&folder).expect("room");
        let (vendor, product) = id.split_once(':').expect("vendor and product");
        let files = [
            ("idVendor", vendor),
            ("idProduct", product),
            ("busnum", "1"),
            ("devnum", "7"),
            ("product", "Depth Camera"),
            ("manufacturer", "Maker"),
        ];
        for (name, text) in files.into_iter().chain(serial.map(|serial| ("serial", serial))) {
            fs::write(folder.join(name), format!("{text}\n")).expect("room");
        }
        folder
    }

    #[test]
    fn devices_are_read_and_interfaces_are_none() {
        let sys = tempfile::tempdir().expect("a folder");
        assert_eq!(UsbDevice::all(sys.path()), []);
        plug(sys.path(), "1-2.4", "8086:0b07", Some("A1"));
        plug(sys.path(), "1-3", "1d27:0601", None);
        fs::create_dir(sys.path().join("bus/usb/devices/1-3:1.0")).expect("room");
        let devices = UsbDevice::all(sys.path());
        assert_eq!(devices.len(), 2, "{devices:?}");
        assert_eq!((devices[0].id, devices[0].serial.as_deref()), ((0x8086, 0x0b07), Some("A1")));
        assert_eq!((&*devices[0].port, &*devices[0].id_text()), ("1-2.4", "8086:0b07"));
        assert_eq!(devices[0].node, Path::new("bus/usb/001/007"));
        assert_eq!((devices[1].serial.as_deref(), &*devices[1].manufacturer), (None, "Maker"));
    }
}
