//! Pixels as V4L2 hands them over, made 16-bit depth.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A pixel format of V4L2 that may hold depth: its code of four characters, without the space at its end.
///
/// # Source
/// The kernel's *Userspace API, Video for Linux*: "Depth Formats" and "Luma-Only Formats". CNF4 is left out: it is how
/// sure a sensor is, not how far something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PixelFormat {
    /// 16-bit depth. Two GUIDs of UVC, `Z16 ` and `INVZ`, are this one in the kernel.
    Z16,
    /// A plane of 16-bit cells with 10-bit infrared, then one of 16-bit depth; neither has padding.
    #[serde(rename = "INZI")]
    Inzi,
    /// 16-bit grey: depth, where the sensor sends it so, or infrared.
    Y16,
    /// 10-bit grey in 16-bit cells.
    Y10,
    /// 10-bit grey, packed, the most significant bits first.
    Y10B,
}

/// Why a frame's bytes are no picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a frame of {found} bytes, expected {expected} for {width}x{height} {format}")]
pub struct SizeError {
    /// Bytes that came.
    pub found: usize,
    /// Bytes that it takes.
    pub expected: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The format.
    pub format: PixelFormat,
}

impl PixelFormat {
    /// All of them, in the order in which they are taken where none is asked for.
    pub const ALL: [Self; 5] = [Self::Z16, Self::Inzi, Self::Y16, Self::Y10, Self::Y10B];

    /// Its code.
    pub fn fourcc(self) -> [u8; 4] {
        *match self {
            Self::Z16 => b"Z16 ",
            Self::Inzi => b"INZI",
            Self::Y16 => b"Y16 ",
            Self::Y10 => b"Y10 ",
            Self::Y10B => b"Y10B",
        }
    }

    /// The format of a code, if it may hold depth.
    pub fn of_fourcc(fourcc: [u8; 4]) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.fourcc() == fourcc)
    }

    /// Whether it can hold nothing but depth.
    pub fn is_depth(self) -> bool {
        matches!(self, Self::Z16 | Self::Inzi)
    }

    /// Bytes of a row without padding; of [`Self::Inzi`], of one of its planes.
    pub fn row_bytes(self, width: usize) -> usize {
        match self {
            Self::Y10B => (10 * width).div_ceil(8),
            _ => 2 * width,
        }
    }

    /// Bytes of a frame of `width`×`height` pixels whose rows begin `stride` bytes after each other (of [`Self::Inzi`] they
    /// follow without padding); 0: without padding, which some drivers mean by it.
    fn frame_bytes(self, [width, height]: [usize; 2], stride: usize) -> usize {
        match self {
            Self::Inzi => 4 * width * height,
            _ => self.stride(width, stride) * height.saturating_sub(1) + self.row_bytes(width),
        }
    }

    fn stride(self, width: usize, stride: usize) -> usize {
        stride.max(self.row_bytes(width))
    }

    /// The depth of a frame, row-major, `width`·`height` counts: `bytes` as the driver gave them, `size` columns and rows,
    /// rows `stride` bytes after each other (0: without padding; those of [`Self::Inzi`] have none). What follows the last
    /// row is not looked at. O(width·height).
    ///
    /// # Errors
    /// When there are fewer bytes than that takes.
    pub fn depth(self, bytes: &[u8], size: [usize; 2], stride: usize) -> Result<Vec<u16>, SizeError> {
        let [width, height] = size;
        let expected = self.frame_bytes(size, stride);
        if bytes.len() < expected {
            return Err(SizeError { found: bytes.len(), expected, width, height, format: self });
        }
        let (plane, stride) = match self {
            Self::Inzi => (&bytes[2 * width * height..], 2 * width),
            _ => (bytes, self.stride(width, stride)),
        };
        let row_bytes = self.row_bytes(width);
        let rows = plane.chunks(stride.max(1)).take(height);
        let mut depth = Vec::with_capacity(width * height);
        for row in rows {
            let row = &row[..row_bytes];
            match self {
                Self::Y10B => depth.extend((0..width).map(|x| packed(row, x))),
                _ => depth.extend(row.chunks_exact(2).map(|cell| u16::from_le_bytes([cell[0], cell[1]]))),
            }
        }
        Ok(depth)
    }
}

/// The 10 bits of pixel `x` of a row.
fn packed(row: &[u8], x: usize) -> u16 {
    let (byte, bit) = (10 * x / 8, 10 * x % 8);
    let two = u16::from_be_bytes([row[byte], row[byte + 1]]);
    (two << bit) >> 6
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(String::from_utf8_lossy(&self.fourcc()).trim_end())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_bit_cells_are_read_row_by_row_without_their_padding() {
        let bytes = [1, 0, 2, 1, 9, 9, 3, 0, 4, 0, 9, 9];
        for format in [PixelFormat::Z16, PixelFormat::Y16, PixelFormat::Y10] {
            assert_eq!(format.depth(&bytes, [2, 2], 6), Ok(vec![1, 258, 3, 4]));
            // The last row needs no padding, and a stride of 0 is none.
            assert_eq!(format.depth(&bytes[..10], [2, 2], 6), Ok(vec![1, 258, 3, 4]));
            assert_eq!(format.depth(&bytes, [2, 2], 0), Ok(vec![1, 258, 0x909, 3]));
        }
    }

    #[test]
    fn of_infrared_and_depth_the_second_plane_is_taken() {
        // In the kernel's documentation: two planes of 16-bit cells, 32 bits a pixel.
        let bytes = [255, 3, 255, 3, 1, 0, 2, 0];
        assert_eq!(PixelFormat::Inzi.depth(&bytes, [2, 1], 8), Ok(vec![1, 2]));
        assert!(PixelFormat::Inzi.depth(&bytes[..7], [2, 1], 0).is_err());
    }

    #[test]
    fn ten_packed_bits_are_taken_apart() {
        // 0x3ff, 0x000, 0x155, 0x2aa, one after the other.
        let bytes = [0b1111_1111, 0b1100_0000, 0b0000_0101, 0b0101_0110, 0b1010_1010];
        assert_eq!(PixelFormat::Y10B.depth(&bytes, [4, 1], 5), Ok(vec![0x3ff, 0, 0x155, 0x2aa]));
        let values: Vec<u16> = (0..64).map(|index| (index * 37) % 1024).collect();
        let mut bits: Vec<u8> = Vec::new();
        for value in &values {
            bits.extend((0..10).rev().map(|bit| (value >> bit & 1) as u8));
        }
        let bytes: Vec<u8> =
            bits.chunks(8).map(|eight| eight.iter().fold(0, |byte, bit| byte << 1 | bit)).collect();
        assert_eq!(PixelFormat::Y10B.depth(&bytes, [32, 2], 40), Ok(values));
    }

    #[test]
    fn too_few_bytes_are_refused_with_both_numbers() {
        let error = PixelFormat::Z16.depth(&[0; 613_999], [640, 480], 1280).expect_err("too few");
        assert_eq!(error.to_string(), "a frame of 613999 bytes, expected 614400 for 640x480 Z16");
        for format in PixelFormat::ALL {
            for size in [[1, 1], [3, 2], [7, 5], [64, 48]] {
                for stride in [0, format.row_bytes(size[0]) + 3] {
                    let needed = format.frame_bytes(size, stride);
                    let depth = format.depth(&vec![0xff; needed], size, stride).expect("enough");
                    assert_eq!(depth.len(), size[0] * size[1], "{format} {size:?} {stride}");
                    assert!(format.depth(&vec![0xff; needed - 1], size, stride).is_err());
                }
            }
        }
    }

    #[test]
    fn a_format_is_known_by_its_code() {
        for format in PixelFormat::ALL {
            assert_eq!(PixelFormat::of_fourcc(format.fourcc()), Some(format));
            let text = toml::Value::try_from(format).expect("TOML");
            assert_eq!(text.as_str(), Some(&*format.to_string()), "the key says what is shown");
        }
        assert_eq!(PixelFormat::of_fourcc(*b"YUYV"), None);
    }
}
