//! `reload`.

use std::fmt::Write;
use std::path::Path;

use common::protocol::{GetStatusReply, ReloadReply};
use common::sentence::print;
use common::station::StationProxy;

use super::{ClientError, Station};
use crate::cli::StationArgs;

/// `sward-capture reload`.
///
/// # Errors
/// When no station answers, it refuses, or stdout cannot be written.
pub fn reload(args: &StationArgs) -> anyhow::Result<()> {
    // That one says where the station is.
    let is_of_client = |set: &String| set.split('=').next().is_some_and(|key| key.trim() == "service.socket");
    if let Some(set) = args.config.sets.iter().find(|set| !is_of_client(set)) {
        let reason = "the station reads its own configuration again and takes no key from here; expected a change of \
                      its file: write the key there and reload, or start the station with it";
        return Err(ClientError::BadFile { file: format!("--set {set}"), reason: reason.to_owned() }.into());
    }
    let mut station = Station::connect(args)?;
    // Who may change but not watch is not told which file it is.
    let status = station.call(async |station| station.get_status().await).ok();
    if let (Some(given), Some(GetStatusReply { status })) = (&args.config.config, status) {
        reads(given, status.config_file.as_deref())?;
    }
    let ReloadReply { changed, restart } = station.call(async |station| station.reload().await)?;
    let mut text = String::new();
    for key in &changed {
        writeln!(text, "{key} is changed")?;
    }
    for key in &restart {
        write!(text, "{key} changes with the next start")?;
        let until = if key == "service.socket" {
            format!("; until then the station listens on {}, for --socket", station.socket)
        } else {
            String::new()
        };
        writeln!(text, "{until}")?;
    }
    if text.is_empty() {
        text.push_str("nothing is changed\n");
    }
    Ok(print(&text)?)
}

/// Whether the file that is given is the one that the station reads.
fn reads(given: &Path, read: Option<&str>) -> Result<(), ClientError> {
    let canonical = given.canonicalize().unwrap_or_else(|_| given.to_path_buf());
    if read.is_some_and(|read| Path::new(read) == canonical) {
        return Ok(());
    }
    let found = read.map_or("the station was started without a configuration file".to_owned(), |read| {
        format!("the station goes by the file {read} and would read that again")
    });
    Err(ClientError::BadFile {
        file: given.display().to_string(),
        reason: format!(
            "{found}; expected its own: leave --config out and name its \
             socket with --socket, or start the station with this file"
        ),
    })
}
