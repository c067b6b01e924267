//! What a preview costs once somebody asks: its bytes, and the sealed memfd that all readers get.

use std::hint::black_box;
use std::sync::Arc;

use anyhow::Context;
use capture_daemon::frame::DepthFrame;
use capture_daemon::preview::{Look, Shown};
use capture_daemon::session::{Session, SessionParams};
use capture_daemon::visitor::Message;
use common::preview::State;
use common::sealed::seal;

use super::{median_ms, timed};

/// Prints the times for frames of a blade that is held until it is captured.
pub(crate) fn times(held: &[DepthFrame]) -> anyhow::Result<()> {
    let params = SessionParams::default();
    let mut session = Session::new(params.clone());
    let capture = held.iter().find_map(|frame| session.push(frame)).context("nothing is captured")?;
    let look = |state, shown| Look {
        sequence: 1,
        frame: Some((0, Arc::new(held[0].clone()))),
        mask: params.pipeline.mask.clone(),
        state,
        hold: 1.0,
        message: Message::Waiting,
        shown,
    };
    println!("\n| preview, once for all readers | ms |\n|---|---|");
    let [waiting, settling] = [State::Waiting, State::Settling].map(|state| look(state, None));
    let bytes = timed("while nothing is before the camera", || waiting.encode())?;
    timed("while the hold runs, with contours of the frame", || settling.encode())?;
    let capture = Arc::new(capture);
    let shown = || Some(Arc::new(Shown::new(Arc::clone(&capture))));
    timed("of a capture, the first: its parts are drawn", || look(State::Captured, shown()).encode())?;
    let captured = look(State::Captured, shown());
    timed("of a capture, each after it", || captured.encode())?;
    let sealed = median_ms(200, || {
        black_box(seal("preview", &bytes).is_ok());
    });
    println!("| sealed memfd of {} bytes | {sealed:.3} |", bytes.len());
    Ok(())
}
