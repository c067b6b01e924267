//! Recordings: what is written is read, and what is damaged is survived.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use capture_daemon::frame::DepthFrame;
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::source::{FrameSource, SourceError};
use capture_daemon::synth::{self, Clip, ClipParams, Family, Format, Scene};
use image::DynamicImage;
use proptest::prelude::*;

/// A short clip of small pictures.
fn small_clip() -> Clip {
    let params = ClipParams { width: 96, height: 72, frames: 12, ..ClipParams::default() };
    Clip::new(Scene::new(Family::Single, 3), params).expect("the parameters are in range")
}

/// All frames, and the reasons for those that were skipped.
fn drain(source: &mut dyn FrameSource) -> (Vec<DepthFrame>, Vec<String>) {
    let (mut frames, mut skipped) = (Vec::new(), Vec::new());
    loop {
        match source.next_frame() {
            Ok(frame) => frames.push(frame),
            Err(SourceError::BadFrame(why)) => skipped.push(why),
            Err(SourceError::End) => return (frames, skipped),
            Err(error) => panic!("{error}"),
        }
    }
}

fn read(path: &Path) -> (Vec<DepthFrame>, Vec<String>) {
    drain(recording::open(path, &OpenOptions::default()).expect("a recording").as_mut())
}

#[test]
fn what_is_written_is_read() {
    let clip = small_clip();
    let expected: Vec<DepthFrame> = clip.frames().collect();
    for format in [Format::Mcap, Format::Png] {
        let folder = tempfile::tempdir().expect("a folder");
        let path = synth::write(folder.path(), &clip, format, 0).expect("written");
        assert_eq!(read(&path), (expected.clone(), Vec::new()), "{format:?}");
    }
}

#[test]
fn a_recording_cut_anywhere_gives_a_prefix_of_its_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = synth::write(folder.path(), &small_clip(), Format::Mcap, 0).expect("written");
    let (whole, bytes) = (read(&path).0, fs::read(&path).expect("readable"));
    let mut most = 0;
    for len in (0..bytes.len()).step_by(bytes.len() / 97) {
        fs::write(&path, &bytes[..len]).expect("written");
        let Ok(mut source) = recording::open(&path, &OpenOptions::default()) else {
            assert_eq!(most, 0, "opens when cut earlier, but not at byte {len}");
            continue;
        };
        let (frames, skipped) = drain(source.as_mut());
        assert_eq!(frames, whole[..frames.len()], "cut at byte {len}");
        assert_eq!(skipped, Vec::<String>::new(), "cut at byte {len}");
        // A longer file never gives fewer frames.
        assert!(frames.len() >= most, "cut at byte {len}");
        most = frames.len();
    }
    assert_eq!(most, whole.len(), "the last cut is within the summary");
}

#[test]
fn of_a_chunk_cut_off_most_messages_are_read() {
    let params = ClipParams { width: 320, height: 240, frames: 12, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Row, 1), params).expect("the parameters are in range");
    let folder = tempfile::tempdir().expect("a folder");
    let path = synth::write(folder.path(), &clip, Format::Mcap, 0).expect("written");
    let bytes = fs::read(&path).expect("readable");
    // Twelve frames of 150 kB are one chunk.
    fs::write(&path, &bytes[..bytes.len() * 3 / 4]).expect("written");
    let (frames, skipped) = read(&path);
    assert!((7..=9).contains(&frames.len()), "{} of 12 frames", frames.len());
    assert_eq!(skipped, Vec::<String>::new());
}

#[test]
fn a_damaged_chunk_costs_frames_of_its_own_only() {
    let params = ClipParams { width: 64, height: 48, frames: 90, ..ClipParams::default() };
    let clip = Clip::new(Scene::new(Family::Row, 1), params).expect("the parameters are in range");
    let folder = tempfile::tempdir().expect("a folder");
    let path = synth::write(folder.path(), &clip, Format::Mcap, 0).expect("written");
    let mut bytes = fs::read(&path).expect("readable");
    // Three chunks of about a second each: the middle of the file is the middle of the second.
    let middle = bytes.len() / 2;
    bytes[middle..middle + 64].fill(0xa5);
    fs::write(&path, bytes).expect("written");
    let (frames, skipped) = read(&path);
    assert_eq!(skipped.len(), 1);
    assert!(skipped[0].contains("the chunk at byte") && skipped[0].contains("damaged"), "{}", skipped[0]);
    let times: Vec<u64> =
        frames.iter().map(|frame| (frame.timestamp_ns - recording::START_NS) / 1_000_000_000).collect();
    for second in [0, 2] {
        assert!(times.iter().filter(|&&time| time == second).count() >= 28, "{times:?}");
    }
    assert!(times.iter().filter(|&&time| time == 1).count() < 30, "{times:?}");
}

/// The sentence that says why a path cannot be opened.
fn refusal(path: &Path) -> String {
    let error = recording::open(path, &OpenOptions::default()).err().expect("not a recording").to_string();
    assert!(!error.contains('\n'), "one sentence: {error}");
    assert!(error.contains(path.to_str().expect("UTF-8")), "names the path: {error}");
    error
}

#[test]
fn what_is_no_recording_is_refused_with_one_sentence() {
    let folder = tempfile::tempdir().expect("a folder");
    let check = |name: &str, bytes: &[u8], expected: &str| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).expect("written");
        let refusal = refusal(&path);
        assert!(refusal.contains(expected), "{refusal}");
    };
    check("text.mcap", b"fx = 570\n", "a text file");
    check("empty.mcap", b"", "an empty file");
    check("short.mcap", b"\x89MCA", "cut off");
    check("magic.mcap", b"\x89MCAP0\r\n", "before its first image");
    check("other.mcap", &[0, 1, 2, 3, 200, 201, 202, 203, 204], "another kind");
    check("session.oni", b"NI10 and more", "OpenNI");
    check("a.png", b"\x89PNG\r\n\x1a\n", "give its folder");
    assert!(refusal(&folder.path().join("missing.mcap")).contains("no such file"));
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).expect("made");
    assert!(refusal(&bag).contains("a folder without PNGs"));
    fs::write(bag.join("metadata.yaml"), "rosbag2_bagfile_information:\n").expect("written");
    assert!(refusal(&bag).contains("a rosbag2 folder"));
    assert!(refusal(Path::new("/dev/null")).contains("neither a file nor a folder"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("random.mcap");
        fs::write(&path, [b"\x89MCAP0\r\n".as_slice(), &bytes].concat()).expect("written");
        prop_assert!(recording::open(&path, &OpenOptions::default()).is_err());
    }

    #[test]
    fn changed_bytes_never_panic(changes in proptest::collection::vec((any::<usize>(), any::<u8>()), 1..8)) {
        let folder = tempfile::tempdir().expect("a folder");
        for compression in [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)] {
            let mut bytes = TINY[compression.map_or(0, |compression| compression as usize + 1)].clone();
            for &(at, byte) in &changes {
                let at = at % bytes.len();
                bytes[at] = byte;
            }
            let path = folder.path().join("changed.mcap");
            fs::write(&path, bytes).expect("written");
            if let Ok(mut source) = recording::open(&path, &OpenOptions::default()) {
                drain(source.as_mut());
            }
        }
    }
}

/// Tiny recordings without compression, with zstd and with lz4.
static TINY: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
    [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)].map(|compression| {
        let folder = tempfile::tempdir().expect("a folder");
        let params = ClipParams { width: 16, height: 16, frames: 3, ..ClipParams::default() };
        let clip = Clip::new(Scene::new(Family::Single, 3), params).expect("the parameters are in range");
        let path = synth::write(folder.path(), &clip, Format::Mcap, 0).expect("written");
        let bytes = fs::read(path).expect("readable");
        let mut output = mcap::WriteOptions::new()
            .profile("ros2")
            .compression(compression)
            .create(std::io::Cursor::new(Vec::new()))
            .expect("in memory");
        for message in mcap::MessageStream::new(&bytes).expect("an MCAP file") {
            output.write(&message.expect("a message")).expect("in memory");
        }
        output.finish().expect("in memory");
        output.into_inner().into_inner()
    })
});

#[test]
fn every_compression_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let frames = TINY.each_ref().map(|bytes| {
        let path = folder.path().join("tiny.mcap");
        fs::write(&path, bytes).expect("written");
        read(&path)
    });
    assert_eq!(frames[0].0.len(), 3);
    assert_eq!(frames[0], frames[1]);
    assert_eq!(frames[0], frames[2]);
}

/// A folder with some pictures of 4×3 pixels.
fn picture_folder(camera: &str, pictures: &[(&str, DynamicImage)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("camera.toml"), camera).expect("written");
    for (name, picture) in pictures {
        picture.save(folder.path().join(name)).expect("written");
    }
    folder
}

const CAMERA: &str = "fx = 5.0\nfy = 5.0\ncx = 2.0\ncy = 1.0\ndepth_unit_m = 0.001\nfps = 10\n";

fn grey(width: u32, height: u32, count: u16) -> DynamicImage {
    image::ImageBuffer::from_pixel(width, height, image::Luma([count])).into()
}

#[test]
fn pictures_that_do_not_fit_are_skipped_and_their_time_passes() {
    let folder = picture_folder(
        CAMERA,
        &[
            ("a.png", grey(4, 3, 700)),
            ("b.png", grey(5, 3, 700)),
            ("c.png", DynamicImage::new_luma8(4, 3)),
            ("d.PNG", grey(4, 3, 0x0102)),
            (".hidden.png", grey(4, 3, 1)),
        ],
    );
    fs::write(folder.path().join("e.png"), b"\x89PNG\r\n\x1a\nand no more").expect("written");
    let (frames, skipped) = read(folder.path());
    assert_eq!(frames.iter().map(|frame| frame.depth[0]).collect::<Vec<_>>(), [700, 0x0102]);
    assert_eq!(frames[1].timestamp_ns, recording::START_NS + 300_000_000);
    assert_eq!(skipped.len(), 3);
    for (why, expected) in skipped.iter().zip(["5x3 pixels", "expected 16-bit grey", "not a whole PNG"]) {
        assert!(why.contains(expected), "{why}");
    }
}

#[test]
fn camera_toml_is_checked_with_line_and_column() {
    let check = |camera: &str, expected: &str| {
        let folder = picture_folder(camera, &[("a.png", grey(4, 3, 700))]);
        let error =
            recording::open(folder.path(), &OpenOptions::default()).err().expect("refused").to_string();
        assert!(error.contains(expected), "{error}");
        assert!(!error.contains('\n'), "{error}");
    };
    check(&format!("{CAMERA}focus = 3\n"), "camera.toml, line 7, column 1: unknown field `focus`");
    check("fx = 5.0\nfy = \"wide\"\n", "line 2, column 6");
    check(&CAMERA.replace("fps = 10", "fps = 0"), "line 6, column 1: fps is 0");
    check(&CAMERA.replace("depth_unit_m = 0.001", "depth_unit_m = 1.0"), "line 5, column 1: depth_unit_m");
    check(&CAMERA.replace("fy = 5.0", "fy = -5.0"), "line 2, column 1: fy is -5");
    check("fx = 5.0\n", "missing field `fy`");
    let folder = picture_folder(CAMERA, &[("a.png", grey(4, 3, 700))]);
    fs::remove_file(folder.path().join("camera.toml")).expect("removed");
    let error = recording::open(folder.path(), &OpenOptions::default()).err().expect("refused").to_string();
    assert!(error.contains("camera.toml: there is no such file"), "{error}");
}

#[test]
fn a_folder_whose_every_picture_is_bad_is_refused() {
    let folder = picture_folder(CAMERA, &[("a.png", DynamicImage::new_luma8(4, 3))]);
    let refusal = refusal(folder.path());
    assert!(refusal.contains("not one frame can be read") && refusal.contains("16-bit grey"), "{refusal}");
}

#[test]
fn a_folder_with_something_in_it_is_not_written_to() {
    let folder = picture_folder(CAMERA, &[]);
    let error = recording::PngWriter::create(folder.path(), 30.0).err().expect("refused").to_string();
    assert!(error.contains("not empty"), "{error}");
}

#[test]
fn real_depth_is_read() {
    let repository = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let shared = std::env::var_os("SWARD_SHARED").map_or(repository.join("../shared"), Into::into);
    let folder = shared.join("data/sorghum_kinect2");
    if !folder.exists() {
        eprintln!("skipped: there is no {}", folder.display());
        return;
    }
    let (frames, skipped) = read(&folder);
    assert_eq!((frames.len(), skipped.len()), (7, 0));
    assert!(frames.iter().all(|frame| (frame.width, frame.height) == (512, 424)));
}

/// A pipe within a folder would be waited for, for ever, by who opens it.
#[cfg(unix)]
#[test]
fn pipes_and_devices_within_folders_are_not_read() {
    use std::os::unix::fs::symlink;

    let pipe = |path: &Path| {
        let made = std::process::Command::new("mkfifo").arg(path).status().expect("mkfifo is there");
        assert!(made.success());
    };
    let folder = picture_folder(CAMERA, &[("b.png", grey(4, 3, 700))]);
    pipe(&folder.path().join("a.png"));
    symlink("/dev/zero", folder.path().join("c.png")).expect("linked");
    let (frames, skipped) = read(folder.path());
    assert_eq!((frames.len(), skipped.len()), (1, 2));
    assert!(skipped.iter().all(|why| why.contains("not a regular file")), "{skipped:?}");
    let camera = folder.path().join("camera.toml");
    fs::remove_file(&camera).expect("removed");
    pipe(&camera);
    assert!(recording::open(folder.path(), &OpenOptions::default()).is_err());

    let bag = tempfile::tempdir().expect("a folder");
    pipe(&bag.path().join("bag_0.mcap"));
    pipe(&bag.path().join("metadata.yaml"));
    let error = recording::open(bag.path(), &OpenOptions::default()).err().expect("refused").to_string();
    assert!(error.contains("not a regular file"), "{error}");
    let error = recording::recover(bag.path(), &bag.path().join("mended")).expect_err("nothing").to_string();
    assert!(error.contains("not one frame"), "{error}");
}

#[test]
fn what_cannot_be_written_leaves_nothing_behind() {
    let folder = tempfile::tempdir().expect("a folder");
    // What is in the way cannot be replaced.
    let taken = folder.path().join("single-3.mcap");
    fs::create_dir(&taken).expect("made");
    fs::write(folder.path().join("single-3"), "in the way").expect("written");
    for format in [Format::Mcap, Format::Png] {
        let error =
            format!("{:#}", synth::write(folder.path(), &small_clip(), format, 0).expect_err("refused"));
        assert!(error.contains("single-3") && error.contains("check the"), "{error}");
    }
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .expect("readable")
        .map(|entry| entry.expect("readable").file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["single-3", "single-3.mcap"]);
}
