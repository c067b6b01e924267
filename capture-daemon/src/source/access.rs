//! Why a node may not be opened, and the command that mends it.

use std::fs;
use std::io;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use nix::unistd::{Gid, Group, Uid, User, getgroups};
use rustix::fs::{Access, access};

use super::profile::Profile;
use super::usb::UsbDevice;

/// Where the rules of udev are installed that give sensors to a group.
const RULES: &str = "/etc/udev/rules.d/59-sward.rules";

/// Owner, group and mode of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Owned {
    owner: String,
    group: String,
    mode: u32,
}

impl Owned {
    fn of(node: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(node)?;
        let owner = User::from_uid(Uid::from_raw(metadata.uid())).ok().flatten().map(|user| user.name);
        let group = Group::from_gid(Gid::from_raw(metadata.gid())).ok().flatten().map(|group| group.name);
        Ok(Self {
            owner: owner.unwrap_or_else(|| metadata.uid().to_string()),
            group: group.unwrap_or_else(|| metadata.gid().to_string()),
            mode: metadata.permissions().mode() & 0o777,
        })
    }
}

/// Whoever wants to open it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Asker {
    name: String,
    /// Whether the group's list names him, which a process that began before does not know.
    is_member: bool,
}

impl Asker {
    /// This process.
    fn own(group: &str) -> Self {
        let user = User::from_uid(Uid::effective()).ok().flatten();
        let name = user.as_ref().map_or_else(|| Uid::effective().to_string(), |user| user.name.clone());
        let listed = Group::from_name(group).ok().flatten();
        let has = listed.as_ref().is_some_and(|group| getgroups().is_ok_and(|own| own.contains(&group.gid)));
        let is_member = !has && listed.is_some_and(|group| group.mem.contains(&name));
        Self { name, is_member }
    }
}

/// What to tell of a node that may not be opened.
fn sentence(node: &Path, owned: &Owned, asker: &Asker) -> (String, String) {
    let Owned { owner, group, mode } = owned;
    let Asker { name, is_member } = asker;
    let found = format!(
        "the user {name} may not read and write {}, which is {owner}:{group} {mode:04o}",
        node.display()
    );
    let is_for_group = mode & 0o060 == 0o060 && group != "root";
    let remedy = if !is_for_group {
        format!(
            "install Sward's rules as {RULES}, then `sudo udevadm control --reload && sudo udevadm trigger --action=add` \
             gives it to the group video"
        )
    } else if *is_member {
        format!(
            "the user is in the group {group}, and was not when this began: log in anew, or restart the service"
        )
    } else {
        format!(
            "`sudo usermod --append --groups {group} {name}` puts the user into the group {group}; log in anew, or restart the service"
        )
    };
    (found, remedy)
}

/// Of a node that this user may not read and write: what is found, and what to do; none where he may.
pub(crate) fn trouble(node: &Path) -> Option<(String, String)> {
    access(node, Access::READ_OK | Access::WRITE_OK).err()?;
    let owned = Owned::of(node).ok()?;
    let asker = Asker::own(&owned.group);
    Some(sentence(node, &owned, &asker))
}

/// The same as a sentence.
pub(super) fn denied(node: &Path) -> Option<String> {
    trouble(node).map(|(found, remedy)| format!("{found}; {remedy}"))
}

/// Sensors of known kinds that are plugged in: kind and USB node; `sys` being `/sys`.
pub(crate) fn known_sensors(sys: &Path) -> Vec<(&'static Profile, PathBuf)> {
    let known =
        |usb: UsbDevice| Some((Profile::of_usb(usb.id.0, usb.id.1)?, Path::new("/dev").join(usb.node)));
    UsbDevice::all(sys).into_iter().filter_map(known).collect()
}

/// Why a sensor that OpenNI2 would read may not be opened.
pub(super) fn denied_to_openni2() -> Option<String> {
    let sensors = known_sensors(Path::new("/sys"));
    sensors.iter().filter(|(profile, _)| profile.is_read_by_openni2).find_map(|(_, node)| denied(node))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(group: &str, mode: u32, is_member: bool) -> String {
        let owned = Owned { owner: "root".to_owned(), group: group.to_owned(), mode };
        let asker = Asker { name: "ada".to_owned(), is_member };
        let (found, remedy) = sentence(Path::new("/dev/video3"), &owned, &asker);
        format!("{found}; {remedy}")
    }

    #[test]
    fn node_group_and_command_are_named() {
        assert_eq!(
            told("video", 0o660, false),
            "the user ada may not read and write /dev/video3, which is root:video 0660; `sudo usermod --append --groups video \
             ada` puts the user into the group video; log in anew, or restart the service"
        );
        assert!(told("video", 0o660, true).contains("log in anew"));
        assert!(!told("video", 0o660, true).contains("usermod"), "he is in it");
        for (group, mode) in [("root", 0o664), ("video", 0o640), ("video", 0o600)] {
            let said = told(group, mode, false);
            assert!(said.contains("udevadm trigger") && said.contains(RULES), "{said}");
        }
    }

    #[test]
    fn what_may_be_opened_is_no_trouble() {
        assert_eq!(trouble(Path::new("/dev/null")), None);
        assert_eq!(trouble(Path::new("/no/such/node")), None);
    }

    #[test]
    fn sensors_of_known_kinds_are_found_by_their_usb_numbers() {
        let sys = tempfile::tempdir().expect("a folder");
        super::super::usb::tests::plug(sys.path(), "1-2", "1d27:0601", None);
        super::super::usb::tests::plug(sys.path(), "1-3", "1d6b:0002", None);
        let found = known_sensors(sys.path());
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].0.name, &*found[0].1), ("xtion", Path::new("/dev/bus/usb/001/007")));
    }
}
