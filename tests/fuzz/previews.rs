//! Previews with damage: a reader maps what another process sealed, and nothing vouches for its bytes.

use std::path::Path;

use common::preview::layout::{HEADER_BYTES, POINT_BYTES, POLYLINE_BYTES, header, polyline};
use common::preview::{
    CaptureNote, Content, HAND, Header, Point, Polyline, PolylineKind, Preview, SEEN, State, encode,
};
use tests::previews::read_all;
use tests::random::Random;

use crate::mutate::change;

const WORDS: [&str; 3] = ["", "Please hold it still.", "Thank you: grün ist’s."];

/// A preview that a station could have made, with its polylines.
fn whole(random: &mut Random) -> (Vec<u8>, usize) {
    let (width, height) =
        if random.once_in(8) { (0, 0) } else { (1 + random.below(24), 1 + random.below(24)) };
    let pixels = width * height;
    let depth_mm: Vec<u16> = (0..pixels).map(|_| random.number() as u16).collect();
    let mask: Vec<u8> = (0..pixels).map(|_| *random.pick(&[0, SEEN, HAND, SEEN | HAND])).collect();
    let labels: Vec<u8> = (0..pixels).map(|_| random.below(256) as u8).collect();
    let mut line = |kind| {
        let point = |random: &mut Random| Point {
            x: random.within(-50.0, 50.0) as f32,
            y: random.within(-1e6, 1e6) as f32,
            half_width_left: random.within(0.0, 9.0) as f32,
            half_width_right: 0.0,
        };
        let points = (0..2 + random.below(6)).map(|_| point(random)).collect();
        Polyline { kind, label: random.below(9) as u32, points }
    };
    let lines = [line(PolylineKind::Skeleton), line(PolylineKind::Contour), line(PolylineKind::Contour)];
    let lines = &lines[..random.below(4)];
    let has_frame = width > 0;
    let capture = CaptureNote { frame: random.number(), timestamp_ns: random.number(), blades: 3 };
    let header = Header {
        sequence: 1 + (random.number() >> 1),
        frame: if has_frame { 31 } else { 0 },
        timestamp_ns: if has_frame { random.number() } else { 0 },
        width: width as u32,
        height: height as u32,
        camera_px: if has_frame { [570.0, 571.0, 3.0, 2.0] } else { [0.0; 4] },
        window_mm: [300, 900],
        state: *random.pick(&[State::NoSource, State::Waiting, State::Settling, State::Captured]),
        hold: random.within(0.0, 1.0) as f32,
        capture: random.once_in(2).then_some(capture),
    };
    let (code, words) =
        (*random.pick(&["waiting", "captured", "a_code_of_all_xx_letters"]), *random.pick(&WORDS));
    let content =
        Content { header, depth_mm: &depth_mm, mask: &mask, labels: &labels, polylines: lines, code, words };
    (encode(&content).expect("it is small"), lines.len())
}

/// What was read, written again.
fn again(preview: &Preview<&[u8]>) -> Vec<u8> {
    let depth_mm: Vec<u16> = preview.depth_mm().collect();
    let lines: Vec<Polyline> = preview
        .polylines()
        .map(|line| Polyline { kind: line.kind(), label: line.label(), points: line.points().collect() })
        .collect();
    let content = Content {
        header: *preview.header(),
        depth_mm: &depth_mm,
        mask: preview.mask(),
        labels: preview.labels(),
        polylines: &lines,
        code: preview.code(),
        words: preview.words(),
    };
    encode(&content).expect("what is read can be written")
}

/// Offsets of the numbers of the header, and of the polylines and points behind the planes.
fn fields(bytes: &[u8], lines: usize) -> Vec<usize> {
    let mut fields: Vec<usize> = (0..HEADER_BYTES).step_by(4).collect();
    let planes = (4 * u32_at(bytes, header::WIDTH) * u32_at(bytes, header::HEIGHT)).next_multiple_of(16);
    let first = HEADER_BYTES + planes;
    for line in (0..lines).map(|line| first + line * POLYLINE_BYTES) {
        fields.extend([polyline::KIND, polyline::FIRST, polyline::COUNT].map(|field| line + field));
    }
    let points = first + lines * POLYLINE_BYTES;
    fields.extend((points..bytes.len().saturating_sub(POINT_BYTES)).step_by(4));
    fields
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize
}

pub(crate) fn case(random: &mut Random, _folder: &Path) {
    let (mut bytes, lines) = whole(random);
    let fields = fields(&bytes, lines);
    let is_damaged = !random.once_in(16);
    if is_damaged {
        for _ in 0..1 + random.below(3) {
            change(&mut bytes, &fields, random);
        }
        // Half of them say their own size, whatever it is.
        if bytes.len() >= HEADER_BYTES && random.once_in(2) {
            let total = (bytes.len() as u64).to_le_bytes();
            bytes[header::TOTAL..header::TOTAL + 8].copy_from_slice(&total);
        }
    }
    match Preview::validate(&bytes[..]) {
        Ok(preview) => {
            read_all(&preview);
            assert_eq!(again(&preview), bytes, "every byte means something, and is as it is written");
        }
        Err(error) => {
            assert!(is_damaged, "{error}");
            let said = error.to_string();
            assert!(!said.is_empty() && !said.contains('\n'), "one sentence: {said:?}");
        }
    }
}
