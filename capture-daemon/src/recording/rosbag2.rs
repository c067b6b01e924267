//! Folders that `ros2 bag record` leaves behind: files in an order that `metadata.yaml` tells.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::mcap::Part;
use super::{OpenError, open_file};

/// The file that makes a folder a rosbag2 one.
pub(super) const METADATA_FILE: &str = "metadata.yaml";
/// It is no longer than this: it lists topics and files.
const MAX_BYTES: u64 = 4 << 20;

/// `metadata.yaml`, as far as it matters here.
#[derive(Deserialize)]
struct MetadataFile {
    rosbag2_bagfile_information: Information,
}

#[derive(Deserialize)]
struct Information {
    storage_identifier: String,
    #[serde(default)]
    relative_file_paths: Vec<String>,
    #[serde(default)]
    compression_format: String,
    #[serde(default)]
    compression_mode: String,
}

/// The files of a folder with a `metadata.yaml`, in its order. One that cannot be read, as a power
/// failure leaves it, is put up with: the folder's MCAP files are taken in the order of their numbers.
///
/// # Errors
/// When they are not MCAP files, or there are none.
pub(super) fn parts(path: &Path) -> Result<Vec<Part>, OpenError> {
    let unsupported = |found: String, remedy| OpenError::Unsupported { path: path.to_owned(), found, remedy };
    let information = match read(&path.join(METADATA_FILE)) {
        Ok(information) => information,
        Err(reason) => {
            let parts = numbered_parts(path)?;
            let metadata = path.join(METADATA_FILE);
            if parts.is_empty() {
                return Err(OpenError::BagMetadata { path: metadata, reason });
            }
            tracing::warn!(
                "{}: {reason}; the folder's MCAP files are read by their names",
                metadata.display()
            );
            return Ok(parts);
        }
    };
    let Information { storage_identifier, relative_file_paths, compression_format, compression_mode } =
        information;
    if storage_identifier != "mcap" {
        return Err(unsupported(
            format!("a rosbag2 folder with the storage {storage_identifier:?}"),
            "convert it to MCAP with `ros2 bag convert`, or record with `--storage mcap`",
        ));
    }
    // MCAP compresses its chunks by itself; this is rosbag2's own compression around it.
    if !compression_mode.is_empty() && !compression_mode.eq_ignore_ascii_case("none") {
        return Err(unsupported(
            format!("a rosbag2 folder with the compression mode {compression_mode} ({compression_format})"),
            "record without `--compression-mode`; MCAP compresses its chunks by itself",
        ));
    }
    // Before ROS 2 Foxy the paths began with the folder itself.
    let locate = |relative: &String| {
        let listed = path.join(relative);
        let beside = Path::new(relative).file_name().map(|name| path.join(name));
        Part { path: beside.filter(|beside| !listed.exists() && beside.exists()).unwrap_or(listed) }
    };
    let parts: Vec<Part> = relative_file_paths.iter().map(locate).collect();
    if parts.is_empty() {
        let reason = "it lists no files; expected their names under relative_file_paths".to_owned();
        return Err(OpenError::BagMetadata { path: path.join(METADATA_FILE), reason });
    }
    Ok(parts)
}

fn read(path: &Path) -> Result<Information, String> {
    let mut text = String::new();
    let file = open_file(path).map_err(|error| format!("it cannot be read ({error})"))?;
    file.take(MAX_BYTES).read_to_string(&mut text).map_err(|error| format!("it cannot be read ({error})"))?;
    let metadata: MetadataFile = serde_saphyr::from_str(&text).map_err(|error| {
        let error = error.without_snippet().to_string();
        format!("it is not the metadata of a rosbag2 folder ({})", error.lines().next().unwrap_or_default())
    })?;
    Ok(metadata.rosbag2_bagfile_information)
}

/// The MCAP files of a folder, in the order of the numbers that their names end with.
pub(super) fn numbered_parts(path: &Path) -> Result<Vec<Part>, OpenError> {
    let io = |source| OpenError::Io { path: path.to_owned(), source };
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(path).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mcap")) {
            files.push(path);
        }
    }
    let number = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let (_, digits) = stem.rsplit_once('_').unwrap_or_default();
        digits.parse::<u64>().unwrap_or(0)
    };
    files.sort_by_cached_key(|path| (number(path), path.clone()));
    Ok(files.into_iter().map(|path| Part { path }).collect())
}
