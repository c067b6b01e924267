//! Is every damaged preview refused, or else readable throughout? A preview carries no hash: whoever sends one
//! chooses all of its bytes.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use common::preview::layout::{self, HEADER_BYTES, MAX_PIXELS, MAX_POINTS, MAX_POLYLINES, header};
use common::preview::{
    CaptureNote, Content, EncodeError, HAND, Header, MAX_BYTES, Point, Polyline, PolylineKind, Preview,
    PreviewError, SEEN, State, encode,
};
use peak_alloc::PeakAlloc;
use tests::previews::read_all;
use tests::random::Random;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;
/// Held by who measures memory, and by who needs much of it.
static MEASURED: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    MEASURED.lock().unwrap_or_else(PoisonError::into_inner)
}

const HEADER: Header = Header {
    sequence: 9,
    frame: 31,
    timestamp_ns: 1_700_000_001_033_333_323,
    width: 7,
    height: 5,
    camera_px: [570.0, 571.0, 3.0, 2.0],
    window_mm: [300, 900],
    state: State::Captured,
    hold: 1.0,
    capture: Some(CaptureNote { frame: 30, timestamp_ns: 1_700_000_001_000_000_000, blades: 1 }),
};

fn polylines() -> Vec<Polyline> {
    let point = |i: u32, half: f32| Point {
        x: i as f32,
        y: 0.5 * i as f32,
        half_width_left: half,
        half_width_right: 2.0 * half,
    };
    let line = |kind, label, count, half| Polyline {
        kind,
        label,
        points: (0..count).map(|i| point(i, half)).collect(),
    };
    vec![line(PolylineKind::Skeleton, 1, 4, 0.5), line(PolylineKind::Contour, 1, 6, 0.0)]
}

fn preview() -> Vec<u8> {
    let depth_mm: Vec<u16> = (0..35).map(|i| 40 * i).collect();
    let mask: Vec<u8> = (0..35).map(|i| [0, SEEN, HAND, SEEN | HAND][i % 4]).collect();
    let labels: Vec<u8> = (0..35).map(|i| i % 3).collect();
    let (code, words) = ("captured", "Thank you: grün ist’s.");
    let polylines = polylines();
    let content = Content {
        header: HEADER,
        depth_mm: &depth_mm,
        mask: &mask,
        labels: &labels,
        polylines: &polylines,
        code,
        words,
    };
    encode(&content).expect("it is small")
}

/// One damaged copy of `bytes`.
fn mutant(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    const EVIL: [u32; 14] = [
        0,
        1,
        2,
        4,
        4097,
        65_537,
        0x7fff_ffff,
        0x8000_0000,
        0xffff_ffff,
        0x7fc0_0000,
        0x7f80_0000,
        0xbf80_0000,
        0x7f7f_ffff,
        0x0001_0000,
    ];
    let mut bytes = bytes.to_vec();
    let end = if random.below(3) == 0 { bytes.len() } else { HEADER_BYTES };
    match random.below(6) {
        0 => {
            let at = random.below(bytes.len());
            bytes[at] ^= 1 << random.below(8);
        }
        1 => bytes.truncate(random.below(bytes.len())),
        2 => bytes.extend((0..1 + random.below(200)).map(|i| i as u8)),
        3 => {
            let (a, b) = (4 * random.below(end / 4), 4 * random.below(end / 4));
            (0..4).for_each(|i| bytes.swap(a + i, b + i));
        }
        _ => {
            let at = 4 * random.below(end / 4);
            bytes[at..at + 4].copy_from_slice(&EVIL[random.below(EVIL.len())].to_le_bytes());
        }
    }
    // Half of them say their own size, whatever it is.
    if bytes.len() >= HEADER_BYTES && random.below(2) == 0 {
        let total = (bytes.len() as u64).to_le_bytes();
        bytes[header::TOTAL..header::TOTAL + 8].copy_from_slice(&total);
    }
    bytes
}

#[test]
fn what_is_written_is_read() {
    let bytes = preview();
    let preview = Preview::validate(&bytes[..]).expect("it is whole");
    read_all(&preview);
    assert_eq!(preview.header(), &HEADER);
    assert_eq!((preview.code(), preview.words()), ("captured", "Thank you: grün ist’s."));
    assert_eq!(preview.depth_mm().nth(34), Some(1360));
    let read = preview.polylines().map(|line| Polyline {
        kind: line.kind(),
        label: line.label(),
        points: line.points().collect(),
    });
    assert_eq!(read.collect::<Vec<_>>(), polylines());
    assert_eq!(bytes.len(), 160 + 4 * 35 + 4 + 2 * 16 + 10 * 16 + 25, "as the interface describes it");
}

#[test]
fn a_damaged_preview_is_refused_for_what_is_wrong_or_readable_throughout() {
    let bytes = preview();
    let _alone = alone();
    let mut random = Random::new(5);
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    for _ in 0..20_000 {
        let mutant = mutant(&bytes, &mut random);
        let reason = match Preview::validate(&mutant[..]) {
            Ok(preview) => {
                read_all(&preview);
                "valid".to_owned()
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                let named = match &error {
                    PreviewError::Head(error) => format!("{error:?}"),
                    error => format!("{error:?}"),
                };
                named.chars().take_while(|c| c.is_alphanumeric()).collect()
            }
        };
        *reasons.entry(reason).or_default() += 1;
    }
    let used = MEMORY.peak_usage() - before;
    assert!(used < 1 << 20, "{used} bytes for previews of {}", bytes.len());
    let expected = [
        "HeaderSize",
        "Image",
        "Kind",
        "Magic",
        "Mask",
        "Number",
        "Point",
        "PointRange",
        "Reserved",
        "Size",
        "Text",
        "TooMany",
        "TooShort",
        "Version",
        "valid",
    ];
    assert_eq!(reasons.keys().map(String::as_str).collect::<Vec<_>>(), expected, "{reasons:?}");
    assert!(reasons["valid"] < 8000, "{reasons:?}");
}

#[test]
fn every_shorter_preview_is_refused() {
    let bytes = preview();
    for length in 0..bytes.len() {
        let mut short = bytes[..length].to_vec();
        if length >= HEADER_BYTES {
            short[header::TOTAL..header::TOTAL + 8].copy_from_slice(&(length as u64).to_le_bytes());
        }
        assert!(Preview::validate(&short[..]).is_err(), "{length} bytes");
    }
}

#[test]
fn sizes_are_bounded_before_they_are_reckoned_with() {
    let with = |fields: &[(usize, u32)]| {
        let mut bytes = preview();
        for (at, value) in fields {
            bytes[*at..*at + 4].copy_from_slice(&value.to_le_bytes());
        }
        Preview::validate(bytes).expect_err("it is another size").to_string()
    };
    let max = u32::MAX;
    assert!(with(&[(header::WIDTH, max), (header::HEIGHT, max)]).contains("at most 1310720"));
    assert!(with(&[(header::WIDTH, 0)]).contains("0×5 pixels"));
    assert!(with(&[(header::POLYLINES, max)]).contains("at most 4096"));
    assert!(with(&[(header::POINTS, max)]).contains("at most 65536"));
    assert!(with(&[(header::WORDS, max)]).contains("at most 512"));
    assert!(with(&[(header::WIDTH, 1280), (header::HEIGHT, 1024)]).contains("its parts take 5243"));
}

#[test]
fn what_a_preview_cannot_hold_is_not_written() {
    let _alone = alone();
    let empty = Header { width: 0, height: 0, camera_px: [0.0; 4], capture: None, ..HEADER };
    let none = Content {
        header: empty,
        depth_mm: &[],
        mask: &[],
        labels: &[],
        polylines: &[],
        code: "waiting",
        words: "",
    };
    let bytes = encode(&none).expect("nothing is small");
    assert_eq!(
        (bytes.len(), Preview::validate(&bytes[..]).expect("valid").header().width),
        (HEADER_BYTES, 0)
    );
    let plane = encode(&Content { depth_mm: &[1], ..none });
    assert!(matches!(plane, Err(EncodeError::Plane { plane: "depth", found: 1, expected: 0 })));
    let too_long = "x".repeat(25);
    assert!(matches!(
        encode(&Content { code: &too_long, ..none }),
        Err(EncodeError::TooMany { found: 25, .. })
    ));
    let line = Polyline { points: vec![polylines()[0].points[0]; MAX_POINTS], ..polylines()[0].clone() };
    assert!(matches!(
        encode(&Content { polylines: &[line.clone(), polylines()[1].clone()], ..none }),
        Err(EncodeError::TooMany { what: "points", .. })
    ));

    // The largest there is, and the bound that the interface names.
    let mut lines: Vec<Polyline> =
        vec![Polyline { points: line.points[..2].to_vec(), ..line.clone() }; MAX_POLYLINES];
    lines[0].points.resize(MAX_POINTS - 2 * (MAX_POLYLINES - 1), line.points[0]);
    let (depth_mm, plane, words) = (vec![9; MAX_PIXELS], vec![1; MAX_PIXELS], "w".repeat(512));
    let header = Header { width: 1280, height: 1024, ..HEADER };
    let code = "a_code_of_all_xx_letters";
    let largest = Content {
        header,
        depth_mm: &depth_mm,
        mask: &plane,
        labels: &plane,
        polylines: &lines,
        code,
        words: &words,
    };
    let bytes = encode(&largest).expect("it fits");
    assert_eq!(bytes.len() as u64, MAX_BYTES);
    assert!(common::protocol::DEFINITION.contains(&format!("at most {MAX_BYTES}\n")));
    let preview = Preview::validate(&bytes[..]).expect("valid");
    assert_eq!((preview.polylines().len(), preview.code()), (MAX_POLYLINES, code));
    read_all(&preview);
}

#[test]
fn points_that_no_polyline_has_are_refused() {
    let mut bytes = preview();
    let second = HEADER_BYTES + 4 * 35 + 4 + layout::POLYLINE_BYTES;
    for (at, value) in
        [(layout::polyline::COUNT, 5_u32), (layout::polyline::COUNT, 7), (layout::polyline::FIRST, 3)]
    {
        let before = bytes.clone();
        bytes[second + at..second + at + 4].copy_from_slice(&value.to_le_bytes());
        assert!(matches!(Preview::validate(&bytes[..]), Err(PreviewError::PointRange { .. })));
        bytes = before;
    }
}
