//! What the camera says of itself: the descriptors of a USB video class device.
//!
//! # Source
//! USB 2.0, chapter 9; USB Device Class Definition for Video Devices 1.0a, sections 3.6 to 3.9, and its Payload
//! Uncompressed, section 3.1.

use super::{CameraParams, Pixels};

/// Class video, its subclasses, and what marks descriptors of a class.
const VIDEO: u8 = 0x0e;
const CONTROL: u8 = 1;
const STREAMING: u8 = 2;
const OF_INTERFACE: u8 = 0x24;
/// The endpoint that frames come from.
pub(super) const FRAMES_IN: u8 = 0x81;
/// 100 ns in a second: the unit of frame intervals.
const TICKS: u32 = 10_000_000;

/// Length first, then the rest.
fn descriptor(rest: &[&[u8]]) -> Vec<u8> {
    let body = rest.concat();
    let length = u8::try_from(body.len() + 1).expect("descriptors are short");
    [&[length][..], &body].concat()
}

/// Time from one frame to the next, in units of 100 ns.
pub(super) fn interval(fps: u32) -> u32 {
    TICKS / fps
}

/// Of the device.
pub(super) fn device(params: &CameraParams) -> Vec<u8> {
    let ([vendor, product], release) =
        ([params.id.0, params.id.1].map(u16::to_le_bytes), 0x0100_u16.to_le_bytes());
    // USB 2.0; a class for each function (EF 02 01); packets of 64 bytes; names 1 to 3; one configuration.
    descriptor(&[&[1, 0x00, 0x02, 0xef, 2, 1, 64], &vendor, &product, &release, &[1, 2, 3, 1]])
}

/// Its one configuration: a function with an interface for control and one for streaming, by bulk transfers.
pub(super) fn configuration(params: &CameraParams) -> Vec<u8> {
    let association = descriptor(&[&[0x0b, 0, 2, VIDEO, 3, 0, 2]]);
    let camera = descriptor(&[&[OF_INTERFACE, 2, 1, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0]]);
    let output = descriptor(&[&[OF_INTERFACE, 3, 2, 0x01, 0x01, 0, 1, 0]]);
    let header_bytes = 13;
    let all = (header_bytes + camera.len() + output.len()) as u16;
    let clock_hz = 48_000_000_u32.to_le_bytes();
    let header = descriptor(&[&[OF_INTERFACE, 1, 0x00, 0x01], &all.to_le_bytes(), &clock_hz, &[1, 1]]);
    let control = descriptor(&[&[4, 0, 0, 0, VIDEO, CONTROL, 0, 0]]);

    let formats = formats(params);
    let all = (14 + formats.len()) as u16;
    let input = descriptor(&[&[OF_INTERFACE, 1, 1], &all.to_le_bytes(), &[FRAMES_IN, 0, 2, 0, 0, 0, 1, 0]]);
    let streaming = descriptor(&[&[4, 1, 0, 1, VIDEO, STREAMING, 0, 0]]);
    let endpoint = descriptor(&[&[5, FRAMES_IN, 2], &512_u16.to_le_bytes(), &[0]]);

    let body = [association, control, header, camera, output, streaming, input, formats, endpoint].concat();
    let all = (9 + body.len()) as u16;
    let head = descriptor(&[&[2], &all.to_le_bytes(), &[2, 1, 0, 0x80, 250]]);
    [head, body].concat()
}

/// The one format, and a frame descriptor for each size.
fn formats(params: &CameraParams) -> Vec<u8> {
    let CameraParams { pixels, sizes, fps, .. } = params;
    let count = u8::try_from(sizes.len()).expect("a few sizes");
    let format = descriptor(&[&[OF_INTERFACE, 4, 1, count], &pixels.guid(), &[pixels.bits(), 1, 0, 0, 0, 0]]);
    let frame = |(index, [width, height]): (u8, &[usize; 2])| {
        let [columns, rows] = [width, height].map(|pixels| (*pixels as u16).to_le_bytes());
        let bytes = pixels.frame_bytes([*width, *height]) as u32;
        let [rate, bytes, interval] = [8 * bytes * fps, bytes, interval(*fps)].map(u32::to_le_bytes);
        let start = [OF_INTERFACE, 5, index, 0];
        descriptor(&[&start, &columns, &rows, &rate, &rate, &bytes, &interval, &[1], &interval])
    };
    let frames: Vec<Vec<u8>> = (1..).zip(sizes).map(frame).collect();
    let colours = descriptor(&[&[OF_INTERFACE, 0x0d, 1, 1, 4]]);
    [format, frames.concat(), colours].concat()
}

/// A name of the device: 1 its maker's, 2 its own, 3 its serial number; 0 the language of these.
pub(super) fn name(index: u8, params: &CameraParams) -> Option<Vec<u8>> {
    let text = match index {
        0 => return Some(descriptor(&[&[3, 0x09, 0x04]])),
        1 => "Sward",
        2 => "Emulated Depth",
        3 => params.serial,
        _ => return None,
    };
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    Some(descriptor(&[&[3], &units]))
}

/// What host and camera agree on before frames come (`probe` and `commit`), 26 bytes.
pub(super) fn agreement(size_index: u8, params: &CameraParams) -> Vec<u8> {
    let size = params.sizes[usize::from(size_index) - 1];
    let bytes = params.pixels.frame_bytes(size) as u32;
    // A frame is one payload: its header and all pixels.
    let [interval, frame, payload] =
        [interval(params.fps), bytes, bytes + super::HEADER_BYTES as u32].map(u32::to_le_bytes);
    [&[1, 0, 1, size_index][..], &interval, &[0; 10], &frame, &payload].concat()
}

impl Pixels {
    /// The GUID by which the kernel knows the format.
    ///
    /// # Source
    /// Linux 6.1, `include/linux/usb/uvc.h`.
    fn guid(self) -> [u8; 16] {
        let of_code = |code: &[u8; 4]| {
            let rest = [0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71];
            let all = [&code[..], &rest].concat();
            all.try_into().expect("4 and 12 bytes")
        };
        match self {
            Self::Z16 => of_code(b"Z16 "),
            Self::Y16 => of_code(b"Y16 "),
            Self::Y10 => of_code(b"Y10 "),
            Self::Invz => *b"INVZ\x90\x2d\x58\x4a\x92\x0b\x77\x3f\x1f\x2c\x55\x6b",
            Self::Inzi => *b"INZI\x66\x1a\x42\xa2\x90\x65\xd0\x18\x14\xa8\xef\x8a",
        }
    }

    /// Bits of a pixel.
    fn bits(self) -> u8 {
        if self == Self::Inzi { 32 } else { 16 }
    }

    /// Bytes of a frame.
    pub(super) fn frame_bytes(self, [width, height]: [usize; 2]) -> usize {
        width * height * usize::from(self.bits()) / 8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_say_what_is_there() {
        let params = CameraParams { sizes: vec![[640, 480], [320, 240]], ..CameraParams::default() };
        assert_eq!((device(&params).len(), agreement(2, &params).len()), (18, 26));
        let all = configuration(&params);
        assert_eq!(usize::from(u16::from_le_bytes([all[2], all[3]])), all.len());
        // From one descriptor to the next one arrives at the end.
        let mut at = 0;
        while at < all.len() {
            at += usize::from(all[at]);
        }
        assert_eq!(at, all.len());
        assert_eq!(name(2, &params).expect("a name")[..4], [30, 3, b'E', 0]);
        assert_eq!(name(4, &params), None);
    }
}
