//! `blades export` and `blades import`.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use common::blade::{Blade, BladeError, MAX_NAME_BYTES};
use common::protocol::{Blade as Listed, MAX_MESSAGE_BYTES, StationError};
use common::sentence::print;
use common::station::{self, StationProxy};
use serde_json::json;

use super::{ClientError, Station};
use crate::cli::StationArgs;
use crate::exchange::svg_import::{self, DrawnBlade, ImportParams, MidribOrigin};
use crate::exchange::{glb, svg_export};
use crate::store::file::{MAX_BYTES as MAX_FILE_BYTES, TextError, utf8};
use crate::store::record::{Provenance, Record, RecordError};

/// What a file is, by the end of its name.
fn kind(file: &Path) -> Option<String> {
    Some(file.extension()?.to_str()?.to_ascii_lowercase())
}

/// Writes blades of the library into a file; no names: all.
pub(super) fn export(file: &Path, names: &[String], args: &StationArgs) -> anyhow::Result<()> {
    let kind = kind(file).filter(|kind| ["svg", "glb"].contains(&kind.as_str()));
    let Some(kind) = kind else {
        let reason =
            "its name does not say what it is to be; expected one that ends with .svg or .glb".into();
        return Err(ClientError::BadFile { file: file.display().to_string(), reason }.into());
    };
    let library = library(args)?;
    let missing = names.iter().find(|name| !library.iter().any(|blade| blade.name() == *name));
    if let Some(name) = missing {
        return Err(ClientError::Refused(StationError::NoSuchBlade { name: name.clone() }).into());
    }
    let chosen = |blade: &&Blade| names.is_empty() || names.iter().any(|name| name == blade.name());
    let blades: Vec<&Blade> = library.iter().filter(chosen).collect();
    let bytes = match kind.as_str() {
        "svg" => svg_export::write(&blades).into_bytes(),
        _ => glb::write(&blades).context("the mesh cannot be written")?,
    };
    write_whole(file, &bytes)
}

/// Writes a file whole, or not at all; one that is there is replaced.
pub(super) fn write_whole(file: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Less the umask, as any other file.
    let mode = std::fs::Permissions::from_mode(0o666);
    let temporary = tempfile::Builder::new().prefix(".sward-").permissions(mode).tempfile_in(folder);
    let written = temporary.and_then(|mut temporary| {
        temporary.write_all(bytes)?;
        temporary.persist(file)?;
        Ok(())
    });
    written
        .with_context(|| format!("{}: it cannot be written; check the folder and the disk", file.display()))
}

/// The blades of the library.
fn library(args: &StationArgs) -> anyhow::Result<Vec<Blade>> {
    let mut station = Station::connect(args)?;
    if station.call(async |station| station.list_blades().await)?.blades.is_empty() {
        bail!("the library is empty; there is nothing to export");
    }
    let (reply, descriptors) = station.call(async |station| {
        let (reply, descriptors) = station.get_library(0).await?;
        Ok(reply.map(|reply| (reply, descriptors)))
    })?;
    let snapshot = station::library(&reply, &descriptors).context("the library cannot be used")?;
    let blade = |view: common::library::BladeView<'_>| {
        let size = [view.length_m(), view.max_width_m()];
        Blade::new(view.id(), view.name(), view.knots(), size, view.captured_unix_ns(), view.quality())
    };
    Ok(snapshot.blades().map(blade).collect::<Result<_, _>>()?)
}

/// Puts the blades of a file into the library, and says of each what became of it.
pub(super) fn import(
    file: &Path,
    name: Option<&str>,
    length_mm: Option<f32>,
    args: &StationArgs,
) -> anyhow::Result<()> {
    let shown = file.display().to_string();
    let bad = |reason: String| ClientError::BadFile { file: shown.clone(), reason };
    let kind = kind(file).unwrap_or_default();
    let longest = match kind.as_str() {
        "svg" => svg_import::MAX_BYTES as u64,
        "toml" => MAX_FILE_BYTES,
        _ => {
            let reason = "its name does not say what it is; expected one that ends with .svg or .toml";
            return Err(bad(reason.into()).into());
        }
    };
    let bytes = bounded(file, longest).map_err(&bad)?;
    let (blades, left) = match kind.as_str() {
        "svg" => drawn(&bytes, length_mm).map_err(&bad)?,
        _ if length_mm.is_some() => {
            return Err(bad("a blade's own file has its length; --length-mm is for drawings".into()).into());
        }
        _ => (vec![own_file(file, bytes, name)?], LeftOut::default()),
    };
    if name.is_some() && blades.len() != 1 {
        return Err(bad(format!("it holds {} blades; --name is for a single one", blades.len())).into());
    }
    let mut station = Station::connect(args)?;
    let there = station.call(async |station| station.list_blades().await)?.blades;
    let mut put = |own: &str, import: &Import| {
        let name = name.unwrap_or(own);
        let text = match import {
            Import::File(text) => text.clone(),
            Import::Drawn(drawn) => {
                let before = there.iter().find(|before| before.name == name);
                let record = record(drawn.blade.clone(), &shown, before);
                record.map_err(|error| bad(error.to_string()))?.to_toml()
            }
        };
        fits(name, &text).map_err(&bad)?;
        station.call(async |station| station.put_blade(name, &text).await)
    };
    let all = blades.len();
    let mut failed = Vec::new();
    for (own, import) in blades {
        match put(&own, &import) {
            Ok(()) => {
                let called = name.unwrap_or(&own);
                let is_replaced = there.iter().any(|before| before.name == called);
                print(&format!("{called}: {}\n", outcome(called, name, &import, is_replaced)))?;
            }
            Err(error) if all == 1 => return Err(error.into()),
            Err(error @ (ClientError::Refused(_) | ClientError::BadFile { .. })) => {
                failed.push(format!("{own:?}: {error}"));
            }
            // No other call would be answered.
            Err(error) => return Err(error).context(format!("{shown}: {own:?} and what follows is not put")),
        }
    }
    for path in left.flat {
        print(&format!("path {path:?} is left out: it is closed and has no area\n"))?;
    }
    for midrib in left.midribs {
        print(&format!(
            "midrib {midrib:?} is not used: it lies in no outline, or in one that has another; move it inside to use it\n"
        ))?;
    }
    if failed.is_empty() {
        return Ok(());
    }
    let (number, reasons) = (failed.len(), failed.join("; "));
    bail!(
        "{shown}: {number} of its {all} blades were not put into the library: {reasons}; the others are in it"
    )
}

/// The bytes of a file, of which there are so many at most.
fn bounded(file: &Path, longest: u64) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    // Nothing longer is of use, and it may be without an end.
    let bounded = std::fs::File::open(file).map(|file| file.take(longest + 1));
    bounded
        .and_then(|mut bounded| bounded.read_to_end(&mut bytes))
        .map_err(|error| format!("{error}; expected a file that can be read"))?;
    if bytes.len() as u64 > longest {
        return Err(format!("it is too long; expected {} KiB at most", longest >> 10));
    }
    Ok(bytes)
}

/// What a drawing holds that becomes nothing.
#[derive(Default)]
struct LeftOut {
    midribs: Vec<String>,
    flat: Vec<String>,
}

/// The blades of a drawing with the names that they are to have, and what is left out.
fn drawn(bytes: &[u8], length_mm: Option<f32>) -> Result<(Vec<Named>, LeftOut), String> {
    let unix_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_nanos() as u64);
    let length_m = length_mm.map(|mm| mm * 1e-3);
    let params = ImportParams { length_m, unix_ns, ..ImportParams::default() };
    let drawing = svg_import::read(bytes, &params).map_err(|error| error.to_string())?;
    let names = distinct(drawing.blades.iter().map(|drawn| fit_for_a_file(drawn.blade.name())).collect());
    let blades = drawing.blades.into_iter().map(|drawn| Import::Drawn(Box::new(drawn)));
    let left = LeftOut { midribs: drawing.unused_midribs, flat: drawing.flat };
    Ok((names.into_iter().zip(blades).collect(), left))
}

/// A blade's own file, and the name that it is to have.
fn own_file(file: &Path, bytes: Vec<u8>, name: Option<&str>) -> Result<Named, ClientError> {
    let shown = file.display();
    let text = utf8(bytes).map_err(|TextError { place, reason }| ClientError::BadFile {
        file: place.map_or(shown.to_string(), |(line, column)| format!("{shown}:{line}:{column}")),
        reason: format!("{reason}, expected the file of a blade, as the store has them"),
    })?;
    let _whole = Record::parse("blade", &text, 0).map_err(|RecordError { line, column, reason }| {
        ClientError::BadFile { file: format!("{shown}:{line}:{column}"), reason }
    })?;
    let stem = file.file_stem().and_then(|stem| stem.to_str()).or(name);
    let stem = stem.ok_or_else(|| ClientError::BadFile {
        file: shown.to_string(),
        reason: "its name is not UTF-8; give the blade's with --name".to_owned(),
    })?;
    Ok((stem.to_owned(), Import::File(text)))
}

/// What became of a blade on its way into the library, where it is `called` so now; `given`: the name that was asked
/// for.
fn outcome(called: &str, given: Option<&str>, import: &Import, is_replaced: bool) -> String {
    let mut text = match import {
        Import::File(_) => "put into the library".to_owned(),
        Import::Drawn(drawn) => {
            let DrawnBlade { blade, likeness, midrib, .. } = drawn.as_ref();
            let [length, wide] = [blade.length_m(), blade.max_width_m()].map(|metres| metres * 1e3);
            let (knots, alike) = (blade.knots().len(), 100.0 * likeness.agreement);
            // As large as it is in the library, not as it is drawn.
            let farthest = likeness.farthest_mm * drawn.scale;
            let midrib = match midrib {
                MidribOrigin::Drawn => "as drawn",
                MidribOrigin::Found => "found",
                MidribOrigin::Straight => "a straight line",
            };
            format!(
                "{length:.1} mm long, {wide:.1} mm wide, {knots} knots, midrib {midrib}; {alike:.0} % like its outline, \
                 {farthest:.1} mm from it at most"
            )
        }
    };
    if let (Import::Drawn(drawn), None) = (import, given) {
        let label = &drawn.label;
        if label.is_empty() {
            text += "; nothing in the drawing gives it a name";
        } else if label != called {
            let _ =
                write!(text, "; the drawing calls it {label:?}, which is taken, too long or no file's name");
        }
    }
    if is_replaced {
        text += "; the one before is in the history";
    }
    text
}

/// Whether the station reads a message as long as the one that puts this blade.
fn fits(name: &str, text: &str) -> Result<(), String> {
    let message = json!({"method": "io.sward.Station.PutBlade", "parameters": {"name": name, "text": text}});
    let bytes = message.to_string().len();
    if bytes <= MAX_MESSAGE_BYTES {
        return Ok(());
    }
    Err(format!(
        "as a message to the station it is {bytes} bytes, expected {MAX_MESSAGE_BYTES} at most; take comments and \
         what is no key of a blade out of it, or put the file into blades/ of the state directory"
    ))
}

/// What is put into the library, and what it is to be called.
type Named = (String, Import);

/// What is put into the library.
enum Import {
    /// A blade's own file, as it is.
    File(String),
    /// A blade from a drawing.
    Drawn(Box<DrawnBlade>),
}

/// The file of a blade from a drawing. Another shape in the place of a blade leaves that one's weight, and whether
/// it is pinned, as they are.
fn record(blade: Blade, source: &str, before: Option<&Listed>) -> Result<Record, BladeError> {
    let provenance = Provenance { source: Some(source.to_owned()), ..Provenance::default() };
    let blade = match before {
        Some(before) => blade.with_mix(before.mix as f32)?,
        None => blade,
    };
    let pinned = before.is_some_and(|before| before.pinned);
    Ok(Record { blade, pinned, sequence: None, measured: None, provenance })
}

/// Names of which no two are alike: the second of a name gets `-2` behind it, and so on.
fn distinct(names: Vec<String>) -> Vec<String> {
    let mut taken: HashSet<String> = names.iter().cloned().collect();
    let mut given = HashSet::new();
    let name_of = |name: String| {
        // Of one that is no name the station says so.
        if name.is_empty() || given.insert(name.clone()) {
            return name;
        }
        let numbered = |number: usize| {
            let mut begin = name.clone();
            let end = format!("-{number}");
            while begin.len() + end.len() > MAX_NAME_BYTES {
                begin.pop();
            }
            format!("{begin}{end}")
        };
        (2..).map(numbered).find(|other| taken.insert(other.clone())).unwrap_or_default()
    };
    names.into_iter().map(name_of).collect()
}

/// A path's name as that of a file.
fn fit_for_a_file(name: &str) -> String {
    name.replace('/', "-").trim_start_matches('.').trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_come_again_are_numbered_past_those_that_are_there() {
        let names = ["fern", "fern", "moss", "fern-2", "fern"].map(str::to_owned);
        assert_eq!(distinct(names.into()), ["fern", "fern-3", "moss", "fern-2", "fern-4"]);
        assert_eq!(distinct(vec![String::new(), String::new()]), ["", ""]);
        let long = "é".repeat(24);
        let names = distinct(vec![long.clone(), long.clone()]);
        assert_eq!((names[0].len(), names[1].as_str()), (48, format!("{}-2", "é".repeat(23)).as_str()));
    }
}
