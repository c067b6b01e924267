//! `blades restore --all`.

use std::time::{Duration, SystemTime};

use anyhow::{Context, bail};
use common::protocol::ListRemovedReply;
use common::sentence::print;
use common::station::StationProxy;

use super::{ClientError, Station};
use crate::cli::StationArgs;

/// Goes back to what names had that no blade has now; `since`: where it went no longer ago.
pub(super) fn all(since: Option<Duration>, args: &StationArgs) -> anyhow::Result<()> {
    let mut station = Station::connect(args)?;
    let ListRemovedReply { removed } = station.call(async |station| station.list_removed().await)?;
    let earliest = since.map(|since| {
        let earliest = SystemTime::now() - since;
        earliest.duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64)
    });
    let chosen = removed.iter().filter(|it| earliest.is_none_or(|earliest| it.kept_unix_ns >= earliest));
    let names: Vec<&str> = chosen.map(|it| it.blade.name.as_str()).collect();
    if names.is_empty() {
        print("nothing was removed that is not there again\n")?;
        return Ok(());
    }
    let mut failed = Vec::new();
    for name in &names {
        match station.call(async |station| station.restore_blade(name, None).await) {
            Ok(()) => print(&format!("{name}: restored\n"))?,
            Err(ClientError::Refused(error)) => failed.push(format!("{name:?}: {error}")),
            // No other call would be answered.
            Err(error) => return Err(error).context(format!("{name:?} and what follows is not restored")),
        }
    }
    if failed.is_empty() {
        return Ok(());
    }
    bail!("{} of {} blades were not restored: {}", failed.len(), names.len(), failed.join("; "));
}
