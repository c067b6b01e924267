//! What random numbers do to bytes and text.

use tests::random::Random;

/// Numbers that are at the border of something.
const EVIL: [u64; 20] = [
    0,
    1,
    2,
    3,
    7,
    8,
    0x7f,
    0xff,
    0x100,
    0x7fff,
    0xffff,
    0x1_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    1 << 40,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    u64::MAX,
];

/// Changes bytes somewhere, or at one of `fields`, which are offsets of numbers.
pub(crate) fn change(bytes: &mut Vec<u8>, fields: &[usize], random: &mut Random) {
    if bytes.is_empty() {
        bytes.push(random.number() as u8);
        return;
    }
    let at = random.below(bytes.len());
    match random.below(10) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = random.number() as u8,
        2 => bytes.truncate(at),
        3 => {
            let end = (at + 1 + random.below(64)).min(bytes.len());
            bytes.drain(at..end);
        }
        4 => {
            let end = (at + 1 + random.below(256)).min(bytes.len());
            let copy = bytes[at..end].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, copy);
        }
        5 => {
            let end = (at + 1 + random.below(64)).min(bytes.len());
            bytes[at..end].fill(*random.pick(&[0, 0xff, 0x80]));
        }
        // Numbers are what a reader believes.
        _ => {
            let at = if fields.is_empty() || random.once_in(8) { at } else { *random.pick(fields) };
            let width = *random.pick(&[1, 2, 4, 8]);
            let end = (at + width).min(bytes.len());
            let at = at.min(end);
            let mut number = [0; 8];
            number[..end - at].copy_from_slice(&bytes[at..end]);
            let old = u64::from_le_bytes(number);
            let new = match random.below(4) {
                0 => old.wrapping_add(1),
                1 => old.wrapping_sub(1),
                2 => random.number(),
                _ => *random.pick(&EVIL),
            };
            bytes[at..end].copy_from_slice(&new.to_le_bytes()[..end - at]);
        }
    }
}

/// Changes text: lines, numbers and single characters.
pub(crate) fn change_text(text: &str, random: &mut Random) -> String {
    const NUMBERS: [&str; 16] = [
        "0",
        "-1",
        "1e308",
        "-1e-320",
        "nan",
        "inf",
        "-inf",
        "65",
        "99999999999999999999",
        "0x7f",
        "1_0",
        "0.0",
        "true",
        "\"\"",
        "[]",
        "{}",
    ];
    const BITS: [&str; 14] =
        ["=", "[", "]", "{", "}", "\"", "\"\"\"", ".", "#", "\n", "\0", "é", "\u{202e}", "'"];
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    if lines.is_empty() {
        return random.pick(&BITS).to_string();
    }
    let at = random.below(lines.len());
    match random.below(7) {
        0 => drop(lines.remove(at)),
        1 => {
            let copy = lines[at].clone();
            let to = random.below(lines.len());
            lines.insert(to, copy);
        }
        2 => {
            let other = random.below(lines.len());
            lines.swap(at, other);
        }
        3 => {
            let end = random.below(lines[at].len() + 1);
            if lines[at].is_char_boundary(end) {
                let bit = *random.pick(&BITS);
                lines[at].insert_str(end, bit);
            }
        }
        4 => {
            let end = random.below(lines[at].len() + 1);
            if lines[at].is_char_boundary(end) {
                lines[at].truncate(end);
            }
        }
        // A key keeps its name and gets another value.
        _ => {
            let keyed: Vec<usize> =
                (0..lines.len()).filter(|&line| lines[line].contains(['=', ':'])).collect();
            if let Some(&at) = keyed.get(random.below(keyed.len().max(1)))
                && let Some(sign) = lines[at].find(['=', ':'])
            {
                let value = match random.below(3) {
                    0 => format!(" {}", random.within(-2.0, 2.0) * 10_f64.powi(random.below(9) as i32 - 4)),
                    _ => format!(" {}", random.pick(&NUMBERS)),
                };
                lines[at].replace_range(sign + 1.., &value);
            }
        }
    }
    lines.join("\n") + "\n"
}
