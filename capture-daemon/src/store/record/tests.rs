//! Does a blade come back from its file as it was, and does a mistake in it have its place?

use proptest::prelude::*;

use super::*;

const SMALLEST: &str = "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.002] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";

fn parse(text: &str) -> Result<Record, String> {
    Record::parse("fern", text, 7).map_err(|error| error.to_string())
}

fn record(numbers: &[f32], sequence: Option<u64>) -> Record {
    let knots: Vec<Knot> = numbers
        .iter()
        .enumerate()
        .map(|(index, number)| Knot {
            position: Vec3::new(*number, 0.01 * index as f32, -number),
            half_width_left: number.abs() * 0.1,
            across: Vec3::new(*number, 0.3, 1.0).normalize(),
            half_width_right: 0.003,
        })
        .collect();
    let id = BladeId::of(3, 1, &knots);
    let size = [length_m(&knots), max_width_m(&knots)];
    Record {
        blade: Blade::new(id, "fern", knots, size, 1_700_000_000_000_000_123, 0.93)
            .and_then(|blade| blade.with_mix(0.25))
            .expect("a valid blade"),
        pinned: true,
        sequence,
        measured: Some(Measured {
            pixels_across: 8.4,
            hausdorff_m: 7e-4,
            length_error_m: 1.2e-3,
            width_error_m: 1e-9,
        }),
        provenance: Provenance {
            source: Some("a \"sensor\"\n\\ of ours".to_owned()),
            frame: Some(31),
            frames: Some(17),
            index: Some(0),
            config: Some("0123456789abcdef".to_owned()),
        },
    }
}

proptest! {
    #[test]
    fn a_blade_comes_back_bit_for_bit(
        numbers in prop::collection::vec(-0.05f32..0.05, 2..=64), sequence in prop::option::of(0..u64::MAX / 2)
    ) {
        let record = record(&numbers, sequence);
        let text = record.to_toml();
        prop_assert_eq!(parse(&text), Ok(record), "{}", text);
    }

    #[test]
    fn every_number_is_read_back_as_it_was(bits in any::<u32>()) {
        let value = f32::from_bits(bits);
        prop_assume!(value.is_finite());
        let read = number(value).parse::<f64>().expect("a number") as f32;
        prop_assert_eq!(read.to_bits(), bits);
    }

    #[test]
    fn no_damage_to_a_file_ends_in_a_panic(at in 0usize..2000, byte in any::<u8>(), cut in any::<bool>()) {
        let mut bytes = record(&[0.1, -0.2, 0.3], Some(4)).to_toml().into_bytes();
        let at = at % bytes.len();
        if cut { bytes.truncate(at) } else { bytes[at] = byte }
        if let Ok(text) = String::from_utf8(bytes) && let Err(error) = Record::parse("fern", &text, 7) {
            prop_assert!(error.line >= 1 && error.column >= 1 && !error.reason.contains('\n'), "{}", error);
        }
    }
}

#[test]
fn sizes_follow_knots_that_were_edited() {
    let written = record(&[0.1, -0.2, 0.3], None);
    let [length_m, width_m] = [0.25, 0.02];
    let blade = &written.blade;
    let blade = Blade::new(blade.id(), "fern", blade.knots().to_vec(), [length_m, width_m], 5, 0.9);
    let written = Record { blade: blade.expect("a valid blade"), ..written };
    let text = written.to_toml();
    let kept = parse(&text.replace("mix = 1.0", "mix = 2.0")).expect("valid");
    assert_eq!([kept.blade.length_m(), kept.blade.max_width_m()], [length_m, width_m], "only knots matter");
    assert!(kept.measured.is_some());

    let edited = parse(&text.replace("half_width_m = [0.030000001, 0.003]", "half_width_m = [0.04, 0.004]"));
    let edited = edited.expect("valid");
    assert_ne!(edited.blade.knots(), written.blade.knots(), "{text}");
    assert_eq!(edited.blade.max_width_m(), 0.044);
    assert_eq!(edited.blade.length_m(), super::length_m(edited.blade.knots()));
    assert_eq!(edited.measured, None, "that was another shape");
    assert_eq!(parse(&edited.to_toml()), Ok(edited), "and stays so");
}

#[test]
fn nobody_holds_up_a_tower() {
    let error = parse(&SMALLEST.replace("[0.0, 0.2, 0.0]", "[0.0, 1e15, 0.0]")).expect_err("too long");
    assert!(error.starts_with("2:") && error.contains("0.001 to 10 m"), "{error}");
}

#[test]
fn the_smallest_file_is_a_blade() {
    let record = parse(SMALLEST).expect("valid");
    let blade = &record.blade;
    assert_eq!((blade.name(), blade.knots().len(), blade.mix(), blade.quality()), ("fern", 2, 1.0, 1.0));
    assert_eq!((blade.length_m(), blade.max_width_m(), blade.captured_unix_ns()), (0.2, 0.006, 7));
    assert_eq!(blade.knots()[0].across, Vec3::X);
    let other = Record::parse("moss", SMALLEST, 7).expect("valid");
    assert_ne!(other.blade.id(), blade.id(), "the same shape under another name is another blade");
    assert_eq!(parse(SMALLEST), Ok(record));
}

#[test]
fn a_mistake_has_its_line_column_and_reason() {
    let broken = |from: &str, to: &str| {
        let text = SMALLEST.replacen(from, to, 1);
        assert_ne!(text, SMALLEST);
        parse(&text).expect_err("it is broken")
    };
    for (from, to, expected) in [
        ("format = 1", "format = 2", "1:10: `format` is 2, expected 1"),
        ("format = 1\n", "", "1:1: missing key `format`"),
        ("format = 1", "format = 1\ncolour = 3", "2:1: unknown key `colour`, expected one of"),
        ("0.2, 0.0]", "nan, 0.0]", "4:3: knot 1 holds a number that is not finite"),
        ("0.2, 0.0]", "0.0, 0.0]", "4:3: knot 1 stands where the knot before it stands"),
        ("0.004, 0.002", "-0.004, 0.002", "3:3: knot 0 has a half width below zero"),
        ("0.002] },", "0.002], across = [0.5, 0.0, 0.0] },", "3:3: knot 0: `across` has length 0.5"),
        ("format = 1", "format = 1\nmix = -1.0", "2:7: mix is -1; expected 0 to 1000000"),
        ("format = 1", "format = 1\nid = \"fern\"", "2:6: `id` is not 32 hexadecimal digits"),
        (
            "half_width_m = [0.0, 0.0]",
            "half_width_m = [0.0]",
            "4:50: `knots[1].half_width_m` is a list of 1, expected a list of 2 numbers",
        ),
        (
            "half_width_m = [0.0, 0.0]",
            "half_width_m = 7",
            "4:50: `knots[1].half_width_m` is the whole number 7, expected a list of 2 numbers",
        ),
        ("knots = [", "knots == [", "2:8: "),
    ] {
        let error = broken(from, to);
        assert!(error.starts_with(expected), "{to}: {error}, expected {expected}");
    }
}

#[test]
fn what_people_write_with_two_digits_is_a_unit_vector() {
    let text = SMALLEST.replace("0.002] },", "0.002], across = [0.71, 0.0, 0.71] },");
    let blade = parse(&text).expect("near enough").blade;
    assert!((blade.knots()[0].across.length() - 1.0).abs() < 1e-6);
}

#[test]
fn a_measurement_that_is_no_number_can_be_written_and_read() {
    for strange in ["nan", "inf", "-inf"] {
        let text = record(&[0.1, -0.2], None)
            .to_toml()
            .replace("pixels_across = 8.4", &format!("pixels_across = {strange}"));
        let written = parse(&text).expect("valid").to_toml();
        assert!(written.contains(&format!("pixels_across = {strange}\n")), "{written}");
        assert_eq!(parse(&written).expect("valid").to_toml(), written);
    }
}

#[test]
fn names_are_names_of_files() {
    for good in ["fern", "blade-12ab34cd", "hoher Farn 2", "草"] {
        assert_eq!(check_name(good), Ok(()));
    }
    for bad in ["", ".fern", "a/b", "..", "fern ", "a\nb", "a\0b", &"g".repeat(49)] {
        assert!(check_name(bad).expect_err("no name").contains("expected 1 to 48 bytes"), "{bad:?}");
    }
}
