//! Why there is nobody to talk to at a socket, and what to do.

use std::io::{Error, ErrorKind};

/// Of a socket to which nobody could connect, for `reason`.
pub(super) fn told(reason: &Error) -> String {
    if reason.kind() == ErrorKind::PermissionDenied {
        return format!(
            "{reason}: this user may not write to the socket, or not enter its folder; join the group that it is given to \
             (`ls -l` shows it, `sudo usermod --append --groups GROUP USER` does it) and log in anew"
        );
    }
    format!(
        "no station answers: {reason}; start one with sward-capture run, or name its socket with --socket: that is \
         the service.socket that it was started with"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_kept_out_is_not_told_to_start_another() {
        let [out, none] = [ErrorKind::PermissionDenied, ErrorKind::NotFound].map(|kind| told(&kind.into()));
        assert!(out.contains("usermod") && !out.contains("sward-capture run"), "{out}");
        assert!(none.contains("sward-capture run") && !none.contains("usermod"), "{none}");
    }
}
