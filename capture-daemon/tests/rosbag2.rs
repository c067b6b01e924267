//! Folders that `ros2 bag record` leaves behind.

use std::fs;
use std::path::Path;

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, McapWriter, OpenOptions, RecordingParams};
use capture_daemon::source::SourceError;
use capture_daemon::synth::{Clip, ClipParams, Family, Scene};

fn frames() -> Vec<DepthFrame> {
    let params = ClipParams { width: 32, height: 24, frames: 33, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Single, 3), params).expect("the parameters are in range");
    clip.frames().collect()
}

/// A folder with the files `bag_0.mcap` … of three frames each, without metadata.
fn bag() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (index, frames) in frames().chunks(3).enumerate() {
        let path = folder.path().join(format!("bag_{index}.mcap"));
        let mut writer = McapWriter::create(&path, RecordingParams::default()).expect("writable");
        frames.iter().for_each(|frame| writer.write(frame).expect("writable"));
        writer.finish().expect("writable");
    }
    folder
}

/// `metadata.yaml` as rosbag2 writes it, for some files.
fn metadata(storage: &str, compression_mode: &str, files: &[String]) -> String {
    let mut paths = String::new();
    for file in files {
        paths += &format!("    - {file}\n");
    }
    format!(
        "rosbag2_bagfile_information:
  version: 9
  storage_identifier: {storage}
  duration:
    nanoseconds: 1066666656
  starting_time:
    nanoseconds_since_epoch: 1700000000000000000
  message_count: 66
  topics_with_message_count:
    - topic_metadata:
        name: /camera/depth/image_rect_raw
        type: sensor_msgs/msg/Image
        serialization_format: cdr
        offered_qos_profiles:
          - history: keep_last
            depth: 5
        type_description_hash: RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47
      message_count: 33
  compression_format: \"\"
  compression_mode: \"{compression_mode}\"
  relative_file_paths:
{paths}  files:
    - path: {first}
      message_count: 6
  custom_data: ~
  ros_distro: jazzy
",
        first = files.first().map_or("~", String::as_str),
    )
}

fn names(count: usize) -> Vec<String> {
    (0..count).map(|index| format!("bag_{index}.mcap")).collect()
}

fn read(path: &Path) -> Result<Vec<DepthFrame>, String> {
    let mut source = recording::open(path, &OpenOptions::default()).map_err(|error| error.to_string())?;
    let mut frames = Vec::new();
    loop {
        match source.next_frame() {
            Ok(frame) => frames.push(frame),
            Err(SourceError::End) => return Ok(frames),
            Err(error) => panic!("{error}"),
        }
    }
}

#[track_caller]
fn refused(folder: &Path, expected: &str) {
    let why = read(folder).expect_err("refused");
    assert!(why.contains(expected) && !why.contains('\n'), "{why}");
}

#[test]
fn files_are_read_in_the_order_of_the_metadata() {
    let folder = bag();
    let write = |files: &[String]| {
        fs::write(folder.path().join("metadata.yaml"), metadata("mcap", "", files)).expect("writable");
    };
    write(&names(11));
    assert_eq!(read(folder.path()), Ok(frames()));
    // Whatever that is, and as old versions write it.
    write(&["elsewhere/bag_10.mcap".to_owned(), "bag_0.mcap".to_owned()]);
    let all = frames();
    assert_eq!(read(folder.path()), Ok([&all[30..33], &all[0..3]].concat()));
}

#[test]
fn without_metadata_the_numbers_of_the_files_count() {
    let folder = bag();
    assert_eq!(read(folder.path()), Ok(frames()), "10 comes behind 9");
    // A power failure may also leave it empty.
    for text in ["", "\0\0\0\0", "rosbag2_bagfile_information:\n  version: 9\n"] {
        fs::write(folder.path().join("metadata.yaml"), text).expect("writable");
        assert_eq!(read(folder.path()), Ok(frames()), "{text:?}");
    }
}

#[test]
fn files_that_are_missing_empty_or_cut_cost_their_own_frames() {
    let folder = bag();
    fs::write(folder.path().join("metadata.yaml"), metadata("mcap", "none", &names(11))).expect("writable");
    let path = |index: usize| folder.path().join(format!("bag_{index}.mcap"));
    fs::remove_file(path(0)).expect("removed");
    fs::write(path(4), "").expect("writable");
    let bytes = fs::read(path(10)).expect("readable");
    fs::write(path(10), &bytes[..bytes.len() - 9]).expect("writable");
    let all = frames();
    assert_eq!(read(folder.path()), Ok([&all[3..12], &all[15..]].concat()));

    let info = recording::info(folder.path(), &OpenOptions::default()).expect("a recording");
    assert_eq!((info.files.len(), info.frames, info.damage.len()), (11, 27, 3), "{:?}", info.damage);
    let mended = folder.path().join("mended.mcap");
    let recovered = recording::recover(folder.path(), &mended).expect("recovered");
    assert_eq!((recovered.images, recovered.damaged_places), (27, 3));
    assert_eq!(read(&mended), Ok([&all[3..12], &all[15..]].concat()));
}

#[test]
fn what_is_not_read_is_refused_with_its_name() {
    let folder = bag();
    let check = |text: &str, expected: &str| {
        fs::write(folder.path().join("metadata.yaml"), text).expect("writable");
        refused(folder.path(), expected);
    };
    check(&metadata("sqlite3", "", &["bag_0.db3".to_owned()]), "the storage \"sqlite3\"");
    check(&metadata("mcap", "FILE", &["bag_0.mcap.zstd".to_owned()]), "the compression mode FILE");
    check(&metadata("mcap", "MESSAGE", &names(1)), "the compression mode MESSAGE");
    check(&metadata("mcap", "", &[]), "it lists no files");
    check(&metadata("mcap", "", &["lost.mcap".to_owned()]), "a file that cannot be read");
    for index in 0..11 {
        fs::remove_file(folder.path().join(format!("bag_{index}.mcap"))).expect("removed");
    }
    check("]", "it is not the metadata of a rosbag2 folder");
    check("", "it is not the metadata of a rosbag2 folder");
    // Of these, a careless reader makes a billion.
    let mut bomb = "a: &a [x,x,x,x,x,x,x,x,x]\n".to_owned();
    for (name, inner) in "bcdefghij".chars().zip("abcdefghi".chars()) {
        bomb += &format!("{name}: &{name} [{}*{inner}]\n", format!("*{inner},").repeat(8));
    }
    check(&bomb, "it is not the metadata of a rosbag2 folder");
}
