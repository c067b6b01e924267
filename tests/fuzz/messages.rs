//! MCAP files that are whole, of messages that are not: their checksums are right, their CDR is wrong.

use std::fs;
use std::path::Path;

use tests::random::Random;

use crate::mutate::change;
use crate::recordings::examine;
use crate::seeds::{CAMERA_INFO, IMAGE, Message, forms, messages, recording};

/// Offsets of the numbers in a message of ours: frame_id is `camera_depth_optical_frame`.
fn fields(message: &Message) -> Vec<usize> {
    // Representation, seconds, nanoseconds, length of frame_id, height, width, length of the next text.
    let mut fields = vec![0, 1, 4, 8, 12, 44, 48, 52];
    match message.schema {
        // Encoding, byte order, step, length of the data.
        IMAGE => fields.extend([56, 57, 62, 64, 68]),
        // Model, number of coefficients, these, and from there on K and what is behind it.
        CAMERA_INFO => fields.extend((56..message.data.len()).step_by(4)),
        _ => {}
    }
    fields.retain(|&field| field < message.data.len());
    fields
}

/// Numbers that lenses and cameras do not have.
const FLOATS: [f64; 12] =
    [0.0, -0.0, 1.0, -1.0, 0.3, -0.3, 1e-300, 1e300, -1e300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

pub(crate) fn case(random: &mut Random, folder: &Path) {
    let mut messages = messages();
    for _ in 0..1 + random.below(4) {
        let count = messages.len();
        let message = &mut messages[random.below(count)];
        let fields = fields(message);
        match random.below(8) {
            0 if count > 1 => {
                let at = random.below(count);
                messages.remove(at);
            }
            1 => {
                message.topic = *random.pick(&["/a", "/depth", "/infrared", "", "/camera/depth/camera_info"])
            }
            2 => message.schema = *random.pick(&[IMAGE, CAMERA_INFO, "std_msgs/msg/String", ""]),
            3 => message.log_time = random.number(),
            // A coefficient or an entry of K.
            4 if message.schema == CAMERA_INFO && message.data.len() >= 88 => {
                let at = 4 + 8 * (8 + random.below(message.data.len() / 8 - 10));
                let number = *random.pick(&FLOATS);
                message.data[at..at + 8].copy_from_slice(&number.to_le_bytes());
            }
            _ => change(&mut message.data, &fields, random),
        }
    }
    let form = *random.pick(&forms());
    let path = folder.join("whole.mcap");
    fs::write(&path, recording(&messages, form())).expect("a temporary file");
    examine(&path, random, folder);
}
