//! USB/IP as it is on the wire.
//!
//! # Source
//! The kernel's Documentation/usb/usbip_protocol.rst.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;

/// Bytes of what each message begins with.
const HEADER_BYTES: usize = 48;
const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
/// A transfer that the device does not know is refused so.
const STALLED: i32 = -32;
/// A transfer that was taken back.
const TAKEN_BACK: i32 = -104;

/// What the host wants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Request {
    /// A transfer by the endpoint for control.
    Control {
        /// Its number.
        number: u32,
        /// Kind, request, value (2), index (2), length (2).
        setup: [u8; 8],
        /// Most bytes of an answer; `None`: it takes none.
        room: Option<usize>,
        /// What comes with it.
        data: Vec<u8>,
    },
    /// A buffer for bytes of frames.
    Frames {
        /// Its number.
        number: u32,
        /// Its bytes.
        room: usize,
    },
    /// A transfer is taken back.
    TakeBack {
        /// The number of this request.
        number: u32,
        /// The number of the transfer.
        of: u32,
    },
}

/// The camera's end of the cable.
#[derive(Debug)]
pub(super) struct Wire(pub(super) UnixStream);

fn word(bytes: &[u8], index: usize) -> u32 {
    u32::from_be_bytes([0, 1, 2, 3].map(|byte| bytes[4 * index + byte]))
}

impl Wire {
    /// What the host wants next; an error at the end.
    pub(super) fn read(&mut self) -> io::Result<Request> {
        let mut header = [0; HEADER_BYTES];
        self.0.read_exact(&mut header)?;
        let [command, number, _, is_in, endpoint, _, length] =
            [0, 1, 2, 3, 4, 5, 6].map(|index| word(&header, index));
        let length = length as usize;
        match (command, endpoint) {
            (SUBMIT, 0) => {
                let mut data = vec![0; if is_in == 0 { length } else { 0 }];
                self.0.read_exact(&mut data)?;
                let setup = header[40..].try_into().expect("8 bytes");
                Ok(Request::Control { number, setup, room: (is_in != 0).then_some(length), data })
            }
            (SUBMIT, _) => Ok(Request::Frames { number, room: length }),
            // What is taken back stands where a transfer has its flags.
            (UNLINK, _) => Ok(Request::TakeBack { number, of: word(&header, 5) }),
            _ => Err(io::Error::other(format!("the host wants {command}, which is nothing"))),
        }
    }

    fn say(&mut self, command: u32, number: u32, status: i32, length: usize, data: &[u8]) -> io::Result<()> {
        let words = [command, number, 0, 0, 0, status.cast_unsigned(), length as u32, 0, 0, 0, 0, 0];
        let mut message: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        message.extend_from_slice(data);
        self.0.write_all(&message)
    }

    /// A transfer is done: the device gives this.
    pub(super) fn give(&mut self, number: u32, data: &[u8]) -> io::Result<()> {
        self.say(SUBMITTED, number, 0, data.len(), data)
    }

    /// A transfer is done: the device took so many bytes.
    pub(super) fn took(&mut self, number: u32, length: usize) -> io::Result<()> {
        self.say(SUBMITTED, number, 0, length, &[])
    }

    /// The device does not know such a transfer.
    pub(super) fn refuse(&mut self, number: u32) -> io::Result<()> {
        self.say(SUBMITTED, number, STALLED, 0, &[])
    }

    /// A transfer is taken back, unless it was done already.
    pub(super) fn taken_back(&mut self, number: u32, was_waiting: bool) -> io::Result<()> {
        self.say(UNLINKED, number, if was_waiting { TAKEN_BACK } else { 0 }, 0, &[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_and_answers_written() {
        let (mut host, camera) = UnixStream::pair().expect("a pair");
        let mut camera = Wire(camera);
        let message = |words: [u32; 10], setup: [u8; 8]| -> Vec<u8> {
            words.iter().flat_map(|word| word.to_be_bytes()).chain(setup).collect()
        };
        host.write_all(&message([1, 7, 0, 1, 0, 0, 18, 0, 0, 0], [0x80, 6, 0, 1, 0, 0, 18, 0]))
            .expect("room");
        let setup = [0x80, 6, 0, 1, 0, 0, 18, 0];
        assert_eq!(
            camera.read().expect("a request"),
            Request::Control { number: 7, setup, room: Some(18), data: Vec::new() }
        );
        host.write_all(&message([1, 8, 0, 0, 0, 0, 2, 0, 0, 0], [0; 8])).expect("room");
        host.write_all(&[5, 6]).expect("room");
        assert_eq!(
            camera.read().expect("a request"),
            Request::Control { number: 8, setup: [0; 8], room: None, data: vec![5, 6] }
        );
        host.write_all(&message([1, 9, 0, 1, 1, 0, 512, 0, 0, 0], [0; 8])).expect("room");
        assert_eq!(camera.read().expect("a request"), Request::Frames { number: 9, room: 512 });
        host.write_all(&message([2, 10, 0, 0, 0, 9, 0, 0, 0, 0], [0; 8])).expect("room");
        assert_eq!(camera.read().expect("a request"), Request::TakeBack { number: 10, of: 9 });

        camera.give(9, &[1, 2, 3]).expect("room");
        camera.taken_back(10, true).expect("room");
        let mut answers = [0; 48 + 3 + 48];
        host.read_exact(&mut answers).expect("both answers");
        assert_eq!((word(&answers, 0), word(&answers, 1), word(&answers, 6)), (3, 9, 3));
        assert_eq!(answers[48..51], [1, 2, 3]);
        assert_eq!((word(&answers[51..], 0), word(&answers[51..], 5)), (4, (-104_i32).cast_unsigned()));
        drop(host);
        assert!(camera.read().is_err());
    }
}
