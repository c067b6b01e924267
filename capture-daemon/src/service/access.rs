//! Who may watch and who may change, by the credentials of the peer that the kernel vouches for.

use nix::unistd::{Group, Uid, User};

/// Who is at the other end of a connection.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct Peer {
    /// User.
    pub(crate) uid: u32,
    /// Groups, the primary one too.
    pub(crate) gids: Vec<u32>,
}

/// Users and groups.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
struct Rule {
    anyone: bool,
    uids: Vec<u32>,
    gids: Vec<u32>,
}

/// Who may watch and who may change. Root and the station's own user may do both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Access {
    own_uid: u32,
    watch: Rule,
    change: Rule,
}

impl Rule {
    /// `*`, users, and groups with an `@` before them; by name or number.
    fn of(entries: &[String], key: &str) -> Self {
        let mut rule = Self::default();
        for entry in entries {
            let known = match entry.strip_prefix('@') {
                _ if entry == "*" => {
                    rule.anyone = true;
                    true
                }
                Some(group) => {
                    let named = || Group::from_name(group).ok().flatten().map(|group| group.gid.as_raw());
                    let gid = group.parse().ok().or_else(named);
                    rule.gids.extend(gid);
                    gid.is_some()
                }
                None => {
                    let named = || User::from_name(entry).ok().flatten().map(|user| user.uid.as_raw());
                    let uid = entry.parse().ok().or_else(named);
                    rule.uids.extend(uid);
                    uid.is_some()
                }
            };
            if !known {
                tracing::warn!(key, entry, "this machine has no such user or group; nobody is meant by it");
            }
        }
        rule
    }

    fn holds(&self, peer: &Peer) -> bool {
        self.anyone || self.uids.contains(&peer.uid) || peer.gids.iter().any(|gid| self.gids.contains(gid))
    }
}

impl Access {
    /// From the lists of the configuration. A name that this machine does not know is warned about.
    pub(crate) fn new(watch: &[String], change: &[String]) -> Self {
        Self {
            own_uid: Uid::effective().as_raw(),
            watch: Rule::of(watch, "service.watch"),
            change: Rule::of(change, "service.change"),
        }
    }

    /// Whether a peer is root or the station's own user.
    pub(crate) fn is_own(&self, peer: &Peer) -> bool {
        peer.uid == 0 || peer.uid == self.own_uid
    }

    /// Whether a peer may change things.
    pub(crate) fn may_change(&self, peer: &Peer) -> bool {
        self.is_own(peer) || self.change.holds(peer)
    }

    /// Whether a peer may watch: who may change may do that too.
    pub(crate) fn may_watch(&self, peer: &Peer) -> bool {
        self.may_change(peer) || self.watch.holds(peer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allowed(watch: &[&str], change: &[&str], uid: u32, gids: &[u32]) -> (bool, bool) {
        let list = |entries: &[&str]| entries.iter().map(|entry| (*entry).to_owned()).collect::<Vec<_>>();
        let access = Access { own_uid: 990, ..Access::new(&list(watch), &list(change)) };
        let peer = Peer { uid, gids: gids.to_vec() };
        (access.may_watch(&peer), access.may_change(&peer))
    }

    #[test]
    fn root_and_the_station_itself_may_do_all() {
        assert_eq!(allowed(&[], &[], 0, &[0]), (true, true));
        assert_eq!(allowed(&[], &[], 990, &[990]), (true, true));
        assert_eq!(allowed(&[], &[], 1000, &[1000]), (false, false));
    }

    #[test]
    fn users_and_groups_may_do_what_they_are_listed_for() {
        assert_eq!(allowed(&["*"], &[], 1000, &[1000]), (true, false));
        assert_eq!(allowed(&["1000"], &[], 1000, &[7]), (true, false));
        assert_eq!(allowed(&["1000"], &[], 1001, &[1000]), (false, false), "a user is no group");
        assert_eq!(allowed(&["@1000"], &[], 1001, &[7, 1000]), (true, false));
        assert_eq!(allowed(&["@1000"], &[], 1000, &[7]), (false, false), "a group is no user");
        assert_eq!(allowed(&[], &["@44"], 1000, &[44]), (true, true), "who may change may watch");
        assert_eq!(allowed(&["nobody-of-that-name"], &["@no-such-group"], 1000, &[1000]), (false, false));
    }

    #[test]
    fn names_are_looked_up() {
        assert_eq!(allowed(&["root"], &["@root"], 1000, &[0]), (true, true));
    }
}
