//! Is every damaged library refused, or else whole after all? Whoever sends bytes over the socket
//! chooses all of them, the hash too; so half of the mutants here carry a hash that fits.

use std::collections::BTreeMap;

use common::blade::{Blade, BladeId, Knot, check_knots};
use common::library::layout::{HEADER_BYTES, KNOT_BYTES, RECORD_BYTES, encode, hash, header};
use common::library::{Snapshot, SnapshotError};
use glam::Vec3;
use tests::random::Random;

fn library() -> Vec<u8> {
    let name_lengths = [1, 7, 47, 48];
    let blades = name_lengths.iter().enumerate().map(|(index, length)| {
        let knots: Vec<Knot> = (0..2 + 3 * index)
            .map(|i| Knot {
                position: Vec3::new(0.001 * (i * i) as f32, 0.01 * i as f32, 0.0),
                half_width_left: 0.002,
                across: Vec3::X,
                half_width_right: 0.003,
            })
            .collect();
        let id = BladeId::of(7, index as u32, &knots);
        Blade::new(id, "g".repeat(*length), knots, [0.05 * (index + 1) as f32, 0.01], 7, 0.9)
            .expect("a valid blade")
    });
    encode(3, &blades.collect::<Vec<_>>()).expect("few blades")
}

/// Offset of some number of the header, a record or a knot: half of them in the header, where most
/// checks are.
fn field(random: &mut Random, len: usize) -> usize {
    let end = if random.below(2) == 0 { HEADER_BYTES } else { len };
    4 * random.below(end.min(len) / 4)
}

/// One damaged copy of `bytes`.
fn mutant(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    const EVIL: [u32; 11] =
        [0, 1, 2, 65, 4097, 0x7fff_ffff, 0xffff_ffff, 0x7fc0_0000, 0x7f80_0000, 0xbf80_0000, 0x7f7f_ffff];
    let mut bytes = bytes.to_vec();
    match random.below(6) {
        0 => {
            let at = random.below(bytes.len());
            bytes[at] ^= 1 << random.below(8);
        }
        1 => bytes.truncate(random.below(bytes.len())),
        2 => bytes.extend((0..1 + random.below(200)).map(|i| i as u8)),
        3 => {
            let (a, b) = (field(random, bytes.len()), field(random, bytes.len()));
            for i in 0..4 {
                bytes.swap(a + i, b + i);
            }
        }
        4 => {
            let at = field(random, bytes.len());
            bytes[at..at + 4].copy_from_slice(&EVIL[random.below(EVIL.len())].to_le_bytes());
        }
        // One of a record's or knot's numbers, whichever blade: the same damage in every place.
        _ => {
            let size = if random.below(2) == 0 { RECORD_BYTES } else { KNOT_BYTES };
            let offset = 4 * random.below(size / 4);
            let at = HEADER_BYTES + offset + size * random.below((bytes.len() - HEADER_BYTES) / size);
            bytes[at..at + 4].copy_from_slice(&EVIL[random.below(EVIL.len())].to_le_bytes());
        }
    }
    bytes
}

/// Gives the bytes a hash that fits them.
fn repaired(mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.len() >= HEADER_BYTES {
        let hash = hash(&bytes);
        bytes[header::HASH..header::HASH + hash.len()].copy_from_slice(&hash);
    }
    bytes
}

/// Reads everything that a valid snapshot offers and holds it to the invariants of a blade.
fn read_all(snapshot: &Snapshot<&[u8]>) {
    let knots = snapshot.knot_bytes().len() / KNOT_BYTES;
    for blade in snapshot.blades() {
        assert!(blade.knot_range().end <= knots);
        assert_eq!(check_knots(&blade.knots()), Ok(()));
        assert!((1..=48).contains(&blade.name().len()));
        assert!(blade.length_m() > 0.0 && blade.max_width_m() >= 0.0 && blade.mix() >= 0.0);
        assert!((0.0..=1.0).contains(&blade.quality()));
        let _ = (blade.id().to_string(), blade.kind(), blade.captured_unix_ns());
    }
}

/// The variant's name.
fn reason(error: &SnapshotError) -> String {
    let named = match error {
        SnapshotError::Head(error) => format!("{error:?}"),
        error => format!("{error:?}"),
    };
    named.chars().take_while(|c| c.is_alphanumeric()).collect()
}

#[test]
fn the_undamaged_library_is_valid() {
    let bytes = library();
    let snapshot = Snapshot::validate(&bytes[..]).expect("it is whole");
    assert_eq!((snapshot.generation(), snapshot.len()), (3, 4));
    read_all(&snapshot);
}

#[test]
fn no_damage_gets_past_the_hash() {
    let bytes = library();
    let mut random = Random::new(1);
    let mut damaged = 0;
    for round in 0..1000 {
        let mutant = mutant(&bytes, &mut random);
        if mutant != bytes {
            damaged += 1;
            assert!(Snapshot::validate(&mutant[..]).is_err(), "mutant {round} is taken for a library");
        }
    }
    assert!(damaged > 800, "only {damaged} of 1000 mutants differ");
}

#[test]
fn with_a_hash_that_fits_a_library_is_refused_for_what_is_wrong_or_readable_throughout() {
    let bytes = library();
    let mut random = Random::new(2);
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for _ in 0..3000 {
        let mutant = repaired(mutant(&bytes, &mut random));
        let reason = match Snapshot::validate(&mutant[..]) {
            Ok(snapshot) => {
                read_all(&snapshot);
                "valid".to_owned()
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                reason(&error)
            }
        };
        *reasons.entry(reason).or_default() += 1;
    }
    let expected = [
        "HeaderSize",
        "Kind",
        "KnotRange",
        "Knots",
        "Magic",
        "Name",
        "Number",
        "Reserved",
        "Size",
        "TooManyBlades",
        "TooShort",
        "Version",
        "valid",
    ];
    assert_eq!(reasons.keys().map(String::as_str).collect::<Vec<_>>(), expected, "{reasons:?}");
    assert!(reasons["valid"] < 1000, "{reasons:?}");
}

#[test]
fn every_single_bit_counts() {
    let bytes = library();
    for bit in 0..8 * bytes.len() {
        let mut mutant = bytes.clone();
        mutant[bit / 8] ^= 1 << (bit % 8);
        assert!(Snapshot::validate(&mutant[..]).is_err(), "bit {bit} may flip unseen");
    }
}

#[test]
fn every_shorter_library_is_refused() {
    let bytes = library();
    for length in 0..bytes.len() {
        assert!(Snapshot::validate(&repaired(bytes[..length].to_vec())[..]).is_err(), "{length} bytes");
    }
}
