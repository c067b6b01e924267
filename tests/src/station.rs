//! A client of the station's socket that shares no code with the programs: varlink as it stands on
//! the wire, JSON ended by a zero byte, with file descriptors beside it.

use std::io::{self, IoSliceMut, Write};
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Instant;

use common::library::Snapshot;
use common::preview::{self, Preview};
use common::sealed::SealedBytes;
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use serde_json::{Value, json};

use crate::programs::DEADLINE;

/// A connection to the station.
#[derive(Debug)]
pub struct Station(UnixStream);

impl Station {
    /// Connects; a reply that takes longer than [`DEADLINE`] fails the test.
    ///
    /// # Panics
    /// If nobody listens.
    pub fn connect(socket: &Path) -> Self {
        let stream = UnixStream::connect(socket).unwrap_or_else(|e| panic!("{}: {e}", socket.display()));
        stream.set_read_timeout(Some(DEADLINE)).expect("a socket has a timeout");
        Self(stream)
    }

    /// Calls `io.sward.Station.<method>`; the reply as it came, and its descriptors.
    ///
    /// # Panics
    /// If the station hangs up, is silent for too long, or answers with something else than JSON.
    pub fn call(&mut self, method: &str, parameters: &Value) -> (Value, Vec<OwnedFd>) {
        self.ask(&format!("io.sward.Station.{method}"), parameters)
    }

    /// The interface as the station describes it, in varlink's own language.
    ///
    /// # Panics
    /// If it does not describe it.
    pub fn description(&mut self) -> String {
        let parameters = json!({"interface": "io.sward.Station"});
        let (reply, _) = self.ask("org.varlink.service.GetInterfaceDescription", &parameters);
        reply["parameters"]["description"].as_str().expect("a description").to_owned()
    }

    /// Calls a method by its full name; the reply as it came, and its descriptors.
    ///
    /// # Panics
    /// If the station hangs up, is silent for too long, or answers with something else than JSON.
    pub fn ask(&mut self, method: &str, parameters: &Value) -> (Value, Vec<OwnedFd>) {
        self.try_ask(method, parameters).expect("the station answers in time")
    }

    /// The same; an error when the station has gone.
    ///
    /// # Errors
    /// When the station hangs up or is silent for too long.
    ///
    /// # Panics
    /// If it answers with something else than JSON.
    pub fn try_ask(&mut self, method: &str, parameters: &Value) -> io::Result<(Value, Vec<OwnedFd>)> {
        let call = json!({"method": method, "parameters": parameters});
        self.send(call.to_string().as_bytes())?;
        self.reply()
    }

    /// Sends the bytes of one message, and the zero byte that ends it.
    ///
    /// # Errors
    /// When the station has gone, or does not read.
    pub fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.0.write_all(&[message, &[0]].concat())
    }

    /// The next reply and its descriptors.
    ///
    /// # Errors
    /// When the station hangs up or is silent for too long.
    ///
    /// # Panics
    /// If it is something else than JSON.
    pub fn reply(&mut self) -> io::Result<(Value, Vec<OwnedFd>)> {
        let (mut reply, mut descriptors) = (Vec::new(), Vec::new());
        while reply.last() != Some(&0) {
            self.receive(&mut reply, &mut descriptors)?;
        }
        reply.pop();
        Ok((serde_json::from_slice(&reply).expect("a reply is JSON"), descriptors))
    }

    fn receive(&self, reply: &mut Vec<u8>, descriptors: &mut Vec<OwnedFd>) -> io::Result<()> {
        let mut bytes = [0; 4096];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(8))];
        let mut ancillary = RecvAncillaryBuffer::new(&mut space);
        let mut slices = [IoSliceMut::new(&mut bytes)];
        // A debugger or a stop of the whole test is no answer.
        let read = rustix::io::retry_on_intr(|| {
            recvmsg(&self.0, &mut slices, &mut ancillary, RecvFlags::CMSG_CLOEXEC)
        })?
        .bytes;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        for message in ancillary.drain() {
            if let RecvAncillaryMessage::ScmRights(rights) = message {
                descriptors.extend(rights);
            }
        }
        reply.extend_from_slice(&bytes[..read]);
        Ok(())
    }

    /// The newest library, as soon as there is one newer than generation `after`.
    ///
    /// # Panics
    /// If what comes is not one sealed, valid library that keeps what the reply says of it.
    pub fn library(&mut self, after: u64) -> Snapshot<SealedBytes> {
        self.try_library(after).expect("the station answers in time")
    }

    /// The same; an error when the station has gone.
    ///
    /// # Errors
    /// When the station hangs up or is silent for too long.
    ///
    /// # Panics
    /// If what comes is not one sealed, valid library that keeps what the reply says of it.
    pub fn try_library(&mut self, after: u64) -> io::Result<Snapshot<SealedBytes>> {
        let (reply, descriptors) = self.try_ask("io.sward.Station.GetLibrary", &json!({"after": after}))?;
        let number = |field: &str| reply["parameters"][field].as_u64().unwrap_or_else(|| panic!("{reply}"));
        assert_eq!((descriptors.len(), number("fd")), (1, 0), "one memfd: {reply}");
        let bytes = SealedBytes::map(&descriptors[0], number("size")).expect("a sealed memfd");
        assert_eq!(bytes.as_ref().len() as u64, number("size"));
        let snapshot = Snapshot::validate(bytes).expect("a valid library");
        assert_eq!(snapshot.generation(), number("generation"));
        assert_eq!(snapshot.len() as u64, number("blades"));
        assert!(snapshot.generation() > after);
        Ok(snapshot)
    }

    /// The newest preview, as soon as there is another than `after`.
    ///
    /// # Panics
    /// If what comes is not one sealed, valid preview that keeps what the reply says of it.
    pub fn preview(&mut self, after: u64) -> Preview<SealedBytes> {
        self.try_preview(after).expect("the station answers in time")
    }

    /// The same; an error when the station has gone.
    ///
    /// # Errors
    /// When the station hangs up or is silent for too long.
    ///
    /// # Panics
    /// If what comes is not one sealed, valid preview that keeps what the reply says of it.
    pub fn try_preview(&mut self, after: u64) -> io::Result<Preview<SealedBytes>> {
        let (reply, descriptors) = self.try_ask("io.sward.Station.GetPreview", &json!({"after": after}))?;
        let reply = &reply["parameters"];
        assert_eq!((descriptors.len(), &reply["fd"]), (1, &json!(0)), "one memfd: {reply}");
        let bytes = SealedBytes::map(&descriptors[0], preview::MAX_BYTES).expect("a sealed memfd");
        let preview = Preview::validate(bytes).expect("a valid preview");
        let header = preview.header();
        let said = json!({
            "sequence": header.sequence, "state": header.state.name(), "code": preview.code(),
            "words": preview.words(), "size": preview.bytes().len(), "fd": 0,
        });
        assert_eq!(*reply, said);
        assert_ne!(header.sequence, after);
        Ok(preview)
    }

    /// The first preview that something holds of, from now on.
    ///
    /// # Panics
    /// If none does within [`DEADLINE`].
    pub fn preview_that(&mut self, holds: impl Fn(&Preview<SealedBytes>) -> bool) -> Preview<SealedBytes> {
        let start = Instant::now();
        let mut preview = self.preview(0);
        while !holds(&preview) {
            assert!(start.elapsed() < DEADLINE, "the last is {:?}", preview.header());
            preview = self.preview(preview.header().sequence);
        }
        preview
    }

    /// The first library with at least `blades` blades.
    pub fn library_of_at_least(&mut self, blades: usize) -> Snapshot<SealedBytes> {
        let mut library = self.library(0);
        while library.len() < blades {
            library = self.library(library.generation());
        }
        library
    }

    /// The reply of `GetStatus`.
    pub fn status(&mut self) -> Value {
        let (mut reply, _) = self.call("GetStatus", &json!({}));
        reply["parameters"]["status"].take()
    }
}
