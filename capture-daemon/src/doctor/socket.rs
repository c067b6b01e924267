//! The socket: whether a station can make it, and what answers there.

use std::fs::{self, Metadata};
use std::io::ErrorKind;
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use common::protocol::StationError;
use nix::sys::socket::getsockopt;
use nix::sys::socket::sockopt::PeerCredentials;
use nix::unistd::{Gid, Group, Uid, User};
use rustix::fs::{Access, access};

use super::{Finding, station};
use crate::client::{ClientError, status_of};

const CHECK: &str = "socket";
/// A station that runs for so long knows its rate of frames.
const RATE_IS_KNOWN_AFTER: Duration = Duration::from_secs(2);

/// A station that answers.
pub(super) struct Running {
    /// The process that the socket is of, where that can be told.
    pub(super) pid: Option<u32>,
    /// Where its frames come from; `none`: nowhere.
    pub(super) source: String,
}

/// The socket's folder, the socket, and the station that answers there, within `deadline`; with
/// what is known of that station.
pub(super) fn examine(socket: &Path, deadline: Duration) -> (Vec<Finding>, Option<Running>) {
    let mut all = vec![folder(socket)];
    let place = socket.display();
    let metadata = match fs::symlink_metadata(socket) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            all.push(Finding::ok(CHECK, place, "it is free: no station runs"));
            return (all, None);
        }
        Err(error) => {
            let remedy = "run this as the station's user or as root";
            all.push(Finding::trouble(
                CHECK,
                place,
                error.to_string(),
                "a path that may be looked at",
                remedy,
            ));
            return (all, None);
        }
    };
    // Where it is a link, what it leads to counts.
    let file_type = fs::metadata(socket).map_or(metadata.file_type(), |metadata| metadata.file_type());
    if !file_type.is_socket() {
        let found = "what is there is not a socket";
        let remedy = "remove it, or set service.socket to another path";
        all.push(Finding::trouble(CHECK, place, found, "a socket, or nothing", remedy));
        return (all, None);
    }
    match status_of(socket, deadline) {
        Ok(status) => {
            let status = if status.frames_per_second > 0.0 || status.source == "none" {
                status
            } else {
                // One that was just started has no rate yet.
                std::thread::sleep(RATE_IS_KNOWN_AFTER);
                status_of(socket, deadline).unwrap_or(status)
            };
            all.push(Finding::ok(CHECK, place, format!("a station answers; {}", owner(&metadata))));
            all.extend(station::examine(&status));
            (all, Some(Running { pid: process_of(socket), source: status.source }))
        }
        Err(error) => {
            all.push(unanswered(socket, &metadata, &error));
            (all, None)
        }
    }
}

/// The process that listens on a socket, or had it made (unix(7), SO_PEERCRED).
fn process_of(socket: &Path) -> Option<u32> {
    let stream = UnixStream::connect(socket).ok()?;
    u32::try_from(getsockopt(&stream, PeerCredentials).ok()?.pid()).ok()
}

/// Whether a station of this user can make its socket, and nobody else can put another in its place.
fn folder(socket: &Path) -> Finding {
    const CHECK: &str = "socket.folder";
    let folder = socket.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let place = folder.display();
    let remedy = "set service.socket to a path in a folder of the station's own";
    let metadata = match fs::metadata(folder) {
        Ok(metadata) if metadata.is_dir() => metadata,
        Ok(_) => return Finding::trouble(CHECK, place, "it is not a folder", "a folder", remedy),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return match nearest(folder) {
                Some(above) if access(&above, Access::WRITE_OK).is_err() => Finding::trouble(
                    CHECK,
                    place,
                    format!("it is not there, and this user cannot make it in {}", above.display()),
                    "a folder that the station may write to",
                    "make it, as systemd's RuntimeDirectory= and systemd-tmpfiles do, or set service.socket",
                ),
                _ => Finding::ok(CHECK, place, "it is not there; the station makes it"),
            };
        }
        Err(error) => return Finding::trouble(CHECK, place, error.to_string(), "a folder", remedy),
    };
    let mode = metadata.mode();
    if mode & 0o002 != 0 && mode & 0o1000 == 0 {
        let found = format!("everyone may replace what is in it; {}", owner(&metadata));
        let expected = "a folder that others do not write to";
        return Finding::trouble(CHECK, place, found, expected, "run chmod o-w on it");
    }
    if access(folder, Access::WRITE_OK | Access::EXEC_OK).is_err() {
        let found = format!("this user cannot make a socket in it; {}", owner(&metadata));
        return Finding::ok(CHECK, place, format!("{found}, and stations of its owner can"));
    }
    Finding::ok(CHECK, place, owner(&metadata))
}

/// The nearest folder above that is there.
fn nearest(folder: &Path) -> Option<PathBuf> {
    folder
        .ancestors()
        .skip(1)
        .map(|above| if above.as_os_str().is_empty() { Path::new(".") } else { above })
        .find(|above| above.is_dir())
        .map(Path::to_path_buf)
}

/// Owner, group and mode, as people name them.
pub(super) fn owner(metadata: &Metadata) -> String {
    let user = User::from_uid(Uid::from_raw(metadata.uid())).ok().flatten();
    let user = user.map_or_else(|| metadata.uid().to_string(), |user| user.name);
    let mode = metadata.mode() & 0o7777;
    format!("owner {user}, group {}, mode {mode:04o}", group(metadata))
}

fn group(metadata: &Metadata) -> String {
    let group = Group::from_gid(Gid::from_raw(metadata.gid())).ok().flatten();
    group.map_or_else(|| metadata.gid().to_string(), |group| group.name)
}

/// Why a socket gives no status.
fn unanswered(socket: &Path, metadata: &Metadata, error: &anyhow::Error) -> Finding {
    let place = socket.display();
    let answer = "a station that answers";
    match error.downcast_ref() {
        Some(ClientError::NoStation { reason, .. }) => match reason.kind() {
            ErrorKind::ConnectionRefused => Finding::trouble(
                CHECK,
                place,
                "nobody listens on it: it is left over from a station that was killed",
                answer,
                "start a station, which replaces it (systemctl start sward-capture, or sward-capture run)",
            ),
            ErrorKind::PermissionDenied => Finding::trouble(
                CHECK,
                place,
                format!("this user may not connect; {}", owner(metadata)),
                "the right to write to it",
                format!("join the group {} and log in anew, or change service.socket_mode", group(metadata)),
            ),
            _ => Finding::trouble(CHECK, place, reason.to_string(), answer, "start the station anew"),
        },
        Some(ClientError::Denied { .. }) => Finding::trouble(
            CHECK,
            place,
            "the station does not let this user watch",
            "a user that service.watch lists",
            "add the user, or a group of his with @ before it, to service.watch, and reload",
        ),
        Some(ClientError::Silent { patience_s, .. }) => Finding::trouble(
            CHECK,
            place,
            format!("who listens there does not answer within {patience_s} s"),
            answer,
            "see its log (journalctl -u sward-capture), and start it anew",
        ),
        Some(ClientError::Refused(StationError::TooManyConnections { limit })) => Finding::trouble(
            CHECK,
            place,
            format!("a station answers, and has as many connections as it may, {limit} for this user"),
            "room for one more",
            "see who they are (ss -xp), close some, or raise service.max_connections and start it anew",
        ),
        _ => {
            let remedy = "see what listens there, or set service.socket to another path";
            Finding::told(CHECK, &place.to_string(), &error.to_string(), "a station of this version", remedy)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::net::UnixListener;

    use super::super::tests::assert_trouble;
    use super::super::{DEADLINE, Verdict};
    use super::*;

    /// What is found of the socket itself.
    fn of(socket: &Path, deadline: Duration) -> Finding {
        let found = examine(socket, deadline);
        found.0.into_iter().find(|finding| finding.check == CHECK).expect("it is looked at")
    }

    #[test]
    fn a_path_is_free_stale_silent_strange_or_no_socket_at_all() {
        let place = tempfile::tempdir().expect("a folder");
        let socket = place.path().join("station.sock");
        assert_eq!(of(&socket, DEADLINE).verdict, Verdict::Ok);

        fs::write(&socket, "notes").expect("room");
        assert_trouble(&of(&socket, DEADLINE), &["not a socket", "service.socket"]);
        fs::remove_file(&socket).expect("it is there");

        let listener = UnixListener::bind(&socket).expect("a free path");
        assert_trouble(&of(&socket, Duration::from_millis(50)), &["does not answer", "journalctl"]);
        let stranger = std::thread::spawn(move || {
            // The one that was left waiting, then those that are answered.
            let answers = [
                "{\"parameters\":{\"status\":7}}\0",
                "{\"parameters\":{\"status\":7}}\0",
                "{\"error\":\"io.sward.Station.TooManyConnections\",\"parameters\":{\"limit\":8}}\0",
            ];
            for answer in answers {
                let (mut stream, _) = listener.accept().expect("it comes");
                let mut heard = [0; 64];
                let _heard = stream.read(&mut heard);
                let _left = stream.write_all(answer.as_bytes());
            }
        });
        assert_trouble(&of(&socket, DEADLINE), &["not understood"]);
        assert_trouble(
            &of(&socket, DEADLINE),
            &["as many connections as it may, 8", "service.max_connections"],
        );
        stranger.join().expect("it ends");
        // Its listener is gone, its file is not.
        assert_trouble(&of(&socket, DEADLINE), &["left over", "start a station"]);
    }

    #[test]
    fn a_folder_that_is_none_or_everyones_is_trouble() {
        let place = tempfile::tempdir().expect("a folder");
        let in_folder = |name: &str| folder(&place.path().join(name).join("station.sock"));
        assert_eq!(in_folder("late/later").verdict, Verdict::Ok);
        fs::write(place.path().join("file"), "").expect("room");
        assert_trouble(&in_folder("file"), &["not a folder"]);
        fs::create_dir(place.path().join("open")).expect("room");
        let set = |mode| fs::set_permissions(place.path().join("open"), PermissionsExt::from_mode(mode));
        set(0o777).expect("it is ours");
        assert_trouble(&in_folder("open"), &["everyone", "mode 0777", "chmod"]);
        set(0o1777).expect("it is ours");
        assert_eq!(in_folder("open").verdict, Verdict::Ok, "as /tmp is");
    }
}
