//! Folders with damage: PNGs and their camera.toml, rosbag2 files and their metadata.yaml.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma};

use tests::random::Random;

use crate::mutate::{change, change_text};
use crate::recordings::examine;
use crate::seeds::RECORDINGS;

const CAMERA: &str = "fx = 20.0\nfy = 20.0\ncx = 8.0\ncy = 8.0\ndepth_unit_m = 0.001\nfps = 30\n";

const METADATA: &str = "rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 100000000
  topics_with_message_count:
    - topic_metadata:
        name: /camera/depth/image
        offered_qos_profiles:
          - depth: 5
      message_count: 3
  compression_format: \"\"
  compression_mode: \"\"
  relative_file_paths:
    - bag_0.mcap
    - bag_1.mcap
  custom_data: ~
";

/// A PNG of one of the kinds that there are.
fn png(random: &mut Random) -> Vec<u8> {
    let (width, height) = (1 + random.below(24) as u32, 1 + random.below(24) as u32);
    let picture: DynamicImage = match random.below(6) {
        0 => DynamicImage::new_luma8(width, height),
        1 => DynamicImage::new_rgb16(width, height),
        2 => DynamicImage::new_luma_a16(width, height),
        _ => ImageBuffer::from_fn(16, 16, |x, y| Luma([(500 + 7 * x + y) as u16])).into(),
    };
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).expect("in memory");
    bytes.into_inner()
}

/// Gives each chunk of a PNG the checksum that it should have.
fn mend_checksums(bytes: &mut [u8]) {
    let mut at = 8;
    while at + 12 <= bytes.len() {
        let len = u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
        let Some(end) = (at + 8).checked_add(len).filter(|end| end + 4 <= bytes.len()) else { break };
        let checksum = crc32(&bytes[at + 4..end]);
        bytes[end..end + 4].copy_from_slice(&checksum.to_be_bytes());
        at = end + 4;
    }
}

/// CRC-32 as in PNG, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| step(crc)))
}

pub(crate) fn case(random: &mut Random, folder: &Path) {
    let path = folder.join("folder");
    if path.exists() {
        fs::remove_dir_all(&path).expect("it is ours");
    }
    fs::create_dir(&path).expect("a temporary folder");
    let write = |name: &str, bytes: &[u8]| fs::write(path.join(name), bytes).expect("a temporary file");
    if random.once_in(3) {
        let mut metadata = METADATA.to_owned();
        for _ in 0..random.below(4) {
            metadata = change_text(&metadata, random);
        }
        for name in ["bag_0.mcap", "bag_1.mcap"] {
            let mut bytes = random.pick(&RECORDINGS).clone();
            if random.once_in(2) {
                change(&mut bytes, &[], random);
            }
            write(name, &bytes);
        }
        write("metadata.yaml", metadata.as_bytes());
    } else {
        let mut camera = CAMERA.to_owned();
        if random.once_in(2) {
            camera = change_text(&camera, random);
        }
        write("camera.toml", camera.as_bytes());
        for index in 0..1 + random.below(3) {
            let mut bytes = png(random);
            for _ in 0..random.below(3) {
                // Signature, then length, kind, width, height, depth, colour, the rest of the header.
                change(&mut bytes, &[8, 12, 16, 20, 24, 25, 26, 27, 28, 33, 37], random);
            }
            if random.once_in(2) {
                mend_checksums(&mut bytes);
            }
            write(&format!("frame_{index}.png"), &bytes);
        }
    }
    examine(&path, random, folder);
}

#[test]
fn checksums_are_those_of_the_encoder() {
    let mut random = Random::new(5);
    for _ in 0..8 {
        let bytes = png(&mut random);
        let mut mended = bytes.clone();
        mend_checksums(&mut mended);
        assert_eq!(mended, bytes);
    }
}
