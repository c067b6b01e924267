//! Files of blades with damage: what people do to them, and what disks do.

use std::path::Path;

use capture_daemon::store::record::Record;

use tests::random::Random;

use crate::mutate::{change, change_text};

const SEEDS: [&str; 2] = [
    "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n",
    "format = 1\nid = \"0123456789abcdef0123456789abcdef\"\nsequence = 3\ncaptured_unix_ns = 1700000000000000000\nmix = 1.0\n\
     pinned = false\nquality = 0.9\nlength_m = 0.21\nmax_width_m = 0.008\nknots = [\n\
     { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004], across = [1.0, 0.0, 0.0] },\n\
     { position_m = [0.01, 0.1, 0.0], half_width_m = [0.003, 0.004], across = [0.71, 0.0, 0.71] },\n\
     { position_m = [0.03, 0.2, 0.01], half_width_m = [1e-4, 0.0], across = [0.0, 0.0, 1.0] },\n]\n\n\
     [measured]\npixels_across = 8.4\nhausdorff_m = 0.0007\nlength_error_m = 0.0012\nwidth_error_m = 0.0004\n\n\
     [provenance]\nsource = \"a sensor\"\nframe = 31\nframes = 17\nindex = 0\nconfig = \"0123456789abcdef\"\n",
];

pub(crate) fn case(random: &mut Random, _folder: &Path) {
    let mut text = (*random.pick(&SEEDS)).to_owned();
    for _ in 0..1 + random.below(3) {
        text = change_text(&text, random);
    }
    if random.once_in(4) {
        let mut bytes = text.into_bytes();
        change(&mut bytes, &[], random);
        text = String::from_utf8_lossy(&bytes).into_owned();
    }
    match Record::parse("fern", &text, random.number() >> 1) {
        Ok(record) => {
            let written = record.to_toml();
            let again = Record::parse("fern", &written, 0).expect("what is written is read");
            // As text: a number of the measurements may be NaN, which is not itself.
            assert_eq!(again.to_toml(), written);
            assert_eq!(again.blade, record.blade);
        }
        Err(error) => {
            let said = error.to_string();
            assert!(!error.reason.is_empty() && !said.contains('\n'), "one sentence: {said:?}");
            assert!(error.line <= text.lines().count() + 1, "{said}");
        }
    }
}
