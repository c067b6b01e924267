//! Do udev's rules give each sensor that something is known of to the group that the station's user is in, and to nobody
//! else? That udev takes them so is shown in the small machine (`vm.rs`).

use std::collections::BTreeSet;
use std::fs;
use std::process::Command;

use capture_daemon::source::profile::PROFILES;
use tests::root;

const RULES: &str = "systemd/rules.d/59-sward.rules";

/// Key, operator and value of each part of a rule.
fn parts(rule: &str) -> Vec<(&str, &str, &str)> {
    fn part(part: &str) -> Option<(&str, &str, &str)> {
        let at = part.find([':', '=', '!', '+'])?;
        let end = at + part[at..].find('"')?;
        Some((&part[..at], &part[at..end], part[end..].trim_matches('"')))
    }
    rule.split(", ").map(|text| part(text).unwrap_or_else(|| panic!("{text} is no part of a rule"))).collect()
}

#[test]
fn every_known_sensor_is_for_the_group_alone() {
    let text = fs::read_to_string(root().join(RULES)).expect("it is there");
    let rules: Vec<&str> = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    let mut of_usb = BTreeSet::new();
    let mut of_video = BTreeSet::new();
    for rule in rules.iter().filter(|rule| rule.contains("idVendor")) {
        let parts = parts(rule);
        let value = |key: &str| {
            let found =
                parts.iter().find(|part| part.0 == key).unwrap_or_else(|| panic!("no {key} in {rule}"));
            (found.1, found.2)
        };
        assert_eq!((value("MODE"), value("GROUP")), ((":=", "0660"), (":=", "video")), "{rule}");
        let (known, keys) = if rule.starts_with("ATTRS{") {
            (&mut of_video, ["ATTRS{idVendor}", "ATTRS{idProduct}"])
        } else {
            (&mut of_usb, ["ATTR{idVendor}", "ATTR{idProduct}"])
        };
        let [vendor, product] = keys.map(|key| u16::from_str_radix(value(key).1, 16).expect("hexadecimal"));
        assert_eq!(parts.len(), 4, "{rule}");
        assert!(known.insert((vendor, product)), "twice: {rule}");
    }
    assert_eq!(rules.iter().filter(|rule| rule.contains("MODE")).count(), of_usb.len() + of_video.len());
    let all: BTreeSet<(u16, u16)> = PROFILES.iter().flat_map(|profile| profile.usb.iter().copied()).collect();
    assert_eq!(of_usb, all, "the rules and the profiles know the same sensors");
    let by_kernel = PROFILES.iter().filter(|profile| !profile.is_read_by_openni2);
    assert_eq!(of_video, by_kernel.flat_map(|profile| profile.usb.iter().copied()).collect());
    // Debian's rules for OpenNI2 would make them everybody's.
    assert!(RULES.rsplit('/').next() < Some("60-libopenni2-0.rules"));
    let members = fs::read_to_string(root().join("systemd/sysusers.d/sward.conf")).expect("it is there");
    assert!(members.lines().any(|line| line == "m sward video"), "the station's user is in that group");
}

#[test]
fn udev_finds_nothing_wrong_with_the_rules() {
    // Since version 254.
    let has_it = |output: &std::process::Output| output.status.success();
    if !Command::new("udevadm").args(["verify", "--help"]).output().as_ref().is_ok_and(has_it) {
        eprintln!("skipped: there is no udevadm verify (systemd 254) here");
        return;
    }
    let verified =
        Command::new("udevadm").args(["verify", "--resolve-names=never"]).arg(root().join(RULES)).output();
    let verified = verified.expect("it runs");
    assert!(verified.status.success(), "{}", String::from_utf8_lossy(&verified.stdout));
}
