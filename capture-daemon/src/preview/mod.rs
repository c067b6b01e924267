//! The preview: what the frame thread hands over of each frame, and how that becomes bytes once somebody asks.
//!
//! To hand over costs the frame thread next to nothing: it gives away the frame that it is done with, and a
//! reference to the last capture. All else is done by whoever serves the readers, once for all of them.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use common::preview::{
    self as layout, CaptureNote, Content, EncodeError, HAND, Header, Point, Polyline, PolylineKind,
};
use glam::Vec2;
use tokio::sync::watch;

use crate::frame::DepthFrame;
use crate::pipeline::Steps;
use crate::session::{Capture, Session};
use crate::stages::accumulate::Accumulation;
use crate::stages::contour::{self, Outline};
use crate::stages::mask::{self, Mask, MaskParams};
use crate::stages::skeleton::Skeleton;
use crate::stages::{cover, presence};
use crate::station::State;
use crate::visitor::{Message, Visitor};

/// One frame as the frame thread saw it.
#[derive(Clone, Debug)]
pub struct Look {
    /// Number of the look, from 1.
    pub sequence: u64,
    /// The frame and its index in its source; `None`: no frames come.
    pub frame: Option<(u64, Arc<DepthFrame>)>,
    /// What counted as held before the camera.
    pub mask: MaskParams,
    /// What the station does.
    pub state: layout::State,
    /// How much of the hold is over, 0..=1.
    pub hold: f32,
    /// What to tell the visitor.
    pub message: Message,
    /// The capture that is still before the camera.
    pub shown: Option<Arc<Shown>>,
}

/// A capture that is shown, and what of it is the same in every preview.
#[derive(Debug)]
pub struct Shown {
    capture: Arc<Capture>,
    drawn: OnceLock<Drawn>,
}

/// What a preview has of a capture: its parts and its skeletons.
#[derive(Clone, Debug, PartialEq)]
struct Drawn {
    labels: Vec<u8>,
    polylines: Vec<Polyline>,
}

impl Shown {
    /// Of a capture whose parts nobody has asked for yet.
    pub fn new(capture: Arc<Capture>) -> Self {
        Self { capture, drawn: OnceLock::new() }
    }

    fn drawn(&self) -> &Drawn {
        self.drawn.get_or_init(|| Drawn::of(&self.capture.steps))
    }
}

impl Look {
    /// Its bytes. O(pixels), and while something is before the camera that of the mask and the contours of one frame.
    ///
    /// # Errors
    /// A frame of more pixels than a preview holds.
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        let code = self.message.code();
        let words = self.message.to_string();
        let capture = self.shown.as_ref().map(|shown| CaptureNote {
            frame: shown.capture.frame,
            timestamp_ns: shown.capture.timestamp_ns,
            blades: shown.capture.steps.blades.len() as u32,
        });
        let [near, far] = [self.mask.near_m, self.mask.far_m].map(|metres| (metres * 1e3).round() as u16);
        let mut header = Header {
            sequence: self.sequence,
            frame: 0,
            timestamp_ns: 0,
            width: 0,
            height: 0,
            camera_px: [0.0; 4],
            window_mm: [near, far],
            state: self.state,
            hold: self.hold,
            capture,
        };
        let Some((index, frame)) = &self.frame else {
            let (depth_mm, mask, labels, polylines) = (&[], &[], &[], &[]);
            return layout::encode(&Content {
                header,
                depth_mm,
                mask,
                labels,
                polylines,
                code,
                words: &words,
            });
        };
        let camera = &frame.camera;
        (header.frame, header.timestamp_ns) = (*index, frame.timestamp_ns);
        (header.width, header.height) = (frame.width as u32, frame.height as u32);
        header.camera_px = [camera.fx, camera.fy, camera.cx, camera.cy].map(|value| value as f32);

        let mut mask = presence::plane(frame, &self.mask);
        let mut drawn = Drawn { labels: vec![0; mask.len()], polylines: Vec::new() };
        if matches!(self.state, layout::State::Settling | layout::State::Captured) {
            let (seen, outlines) = look_at(frame, &self.mask);
            add_hand(&mut mask, &seen);
            // A sensor that changes its resolution has left the capture's picture behind.
            let shown = self.shown.as_ref().filter(|shown| has_size_of(&shown.capture.steps.mask, frame));
            let mut skeletons = Vec::new();
            if let Some(shown) = shown {
                let is_there = still_there(frame, &shown.capture.steps.mask);
                (drawn.labels, skeletons) = shown.drawn().where_it_is(&is_there);
            }
            drawn.polylines = fitting(skeletons, contours(&outlines));
        }
        let depth_mm = depth_mm(frame);
        layout::encode(&Content {
            header,
            depth_mm: &depth_mm,
            mask: &mask,
            labels: &drawn.labels,
            polylines: &drawn.polylines,
            code,
            words: &words,
        })
    }
}

fn has_size_of(mask: &Mask, frame: &DepthFrame) -> bool {
    (mask.width, mask.height) == (frame.width, frame.height)
}

/// At which pixels a frame shows something at the depth that it had in a capture, row-major.
fn still_there(frame: &DepthFrame, mask: &Mask) -> Vec<bool> {
    /// Farther from where it was it is something else, metres.
    const NEAR_M: f32 = 0.02;
    let unit_m = frame.depth_unit_m as f32;
    let is_near = |(counts, depth_m): (&u16, &f32)| {
        *counts != 0 && (f32::from(*counts) * unit_m - depth_m).abs() < NEAR_M
    };
    frame.depth.iter().zip(&mask.depth_m).map(is_near).collect()
}

/// What one frame alone shows, as the stages have it.
fn look_at(frame: &DepthFrame, params: &MaskParams) -> (Mask, Vec<Outline>) {
    let mut seen = Accumulation::like(frame);
    seen.add(frame, params);
    let mask = mask::extract(&seen, params);
    let outlines = contour::trace(&mask, &mask.pieces);
    (mask, outlines)
}

fn add_hand(plane: &mut [u8], mask: &Mask) {
    // Empty where there is no hand.
    for (bits, is_hand) in plane.iter_mut().zip(&mask.hand) {
        *bits |= if *is_hand { HAND } else { 0 };
    }
}

fn depth_mm(frame: &DepthFrame) -> Cow<'_, [u16]> {
    let mm = frame.depth_unit_m * 1e3;
    if (mm - 1.0).abs() < 1e-9 {
        return Cow::Borrowed(&frame.depth);
    }
    // `as` saturates; what is nearer than half a millimetre is a reading all the same.
    let in_mm = |counts: u16| if counts == 0 { 0 } else { ((f64::from(counts) * mm).round() as u16).max(1) };
    frame.depth.iter().map(|counts| in_mm(*counts)).collect()
}

impl Drawn {
    fn of(steps: &Steps) -> Self {
        let blades = blades_of_skeletons(steps);
        let skeletons = steps.skeletons.iter().zip(&blades).map(|(skeleton, blade)| Polyline {
            kind: PolylineKind::Skeleton,
            label: *blade,
            points: skeleton
                .stations
                .iter()
                .map(|station| Point {
                    x: station.mid.x,
                    y: station.mid.y,
                    half_width_left: station.left_px.max(0.0),
                    half_width_right: station.right_px.max(0.0),
                })
                .collect(),
        });
        Self { labels: labels(steps, &blades), polylines: skeletons.collect() }
    }

    /// Its parts and skeletons as far as they are where they were: those of which at least half of the pixels are
    /// still there.
    fn where_it_is(&self, is_there: &[bool]) -> (Vec<u8>, Vec<Polyline>) {
        let mut pixels = [[0_usize; 2]; 256];
        for (label, is_there) in self.labels.iter().zip(is_there) {
            pixels[usize::from(*label)][usize::from(*is_there)] += 1;
        }
        let stays = pixels.map(|[gone, there]| there >= gone);
        let labels =
            self.labels.iter().map(|label| if stays[usize::from(*label)] { *label } else { 0 }).collect();
        // Those that were refused have no part that is known to be theirs: they go with the last blade.
        let some_stay = (1..=255).any(|label| pixels[label] != [0, 0] && stays[label]);
        let skeletons = self.polylines.iter().filter(|line| match usize::try_from(line.label) {
            Ok(0) | Err(_) => some_stay,
            Ok(label) => stays[label.min(255)],
        });
        (labels, skeletons.cloned().collect())
    }
}

/// The number of each skeleton's blade in the capture, from 1; 0 for one that is none. Refinement keeps both
/// ends of a midrib where they are.
fn blades_of_skeletons(steps: &Steps) -> Vec<u32> {
    let mut numbers = vec![0; steps.skeletons.len()];
    for (blade, number) in steps.blades.iter().zip(1..) {
        let apart = |index: usize| {
            let (ours, theirs) = (&blade.knots_in_camera, &steps.lifted[index].knots_in_camera);
            let ends = ours.first().zip(theirs.first()).into_iter().chain(ours.last().zip(theirs.last()));
            ends.map(|(a, b)| a.position.distance(b.position)).sum::<f32>()
        };
        let free = (0..numbers.len().min(steps.lifted.len())).filter(|index| numbers[*index] == 0);
        if let Some(index) = free.min_by(|a, b| apart(*a).total_cmp(&apart(*b))) {
            numbers[index] = number;
        }
    }
    numbers
}

/// Whose part each pixel is of, as a preview has it.
fn labels(steps: &Steps, blades: &[u32]) -> Vec<u8> {
    let of = cover::cover(&steps.mask, &steps.parts);
    // A part is of the blade most of whose cross-sections lie on it.
    let mut lying = vec![vec![0_u32; steps.blades.len() + 1]; steps.parts.len() + 1];
    for (skeleton, blade) in steps.skeletons.iter().zip(blades) {
        for index in skeleton.stations.iter().filter_map(|station| steps.mask.index_at(station.mid)) {
            lying[of[index] as usize][*blade as usize] += 1;
        }
    }
    let mut others = steps.blades.len();
    let mut label = |lying: &Vec<u32>| {
        let (blade, most) =
            lying.iter().enumerate().skip(1).rev().max_by_key(|(_, count)| **count).unwrap_or((0, &0));
        if *most > 0 {
            return blade;
        }
        others += 1;
        others
    };
    let labels = lying.iter().skip(1).map(|lying| u8::try_from(label(lying)).unwrap_or(u8::MAX));
    let labels: Vec<u8> = std::iter::once(0).chain(labels).collect();
    let mut of: Vec<u8> = of.iter().map(|part| labels[*part as usize]).collect();
    // Where it is known to lie a blade has its pixels, whosever part it shares.
    for (skeleton, blade) in steps.skeletons.iter().zip(blades).filter(|(_, blade)| **blade > 0) {
        paint(&steps.mask, skeleton, u8::try_from(*blade).unwrap_or(u8::MAX), &mut of);
    }
    of
}

/// Gives a blade the pixels between its edges at which it is what is seen.
fn paint(mask: &Mask, skeleton: &Skeleton, label: u8, of: &mut [u8]) {
    /// Readings farther from it are of something before or behind it, metres.
    const NEAR_M: f32 = 0.015;
    const STEP_PX: f32 = 0.5;
    for pair in skeleton.stations.windows(2) {
        let steps = (pair[0].mid.distance(pair[1].mid) / STEP_PX).ceil().max(1.0);
        for t in (0..steps as u32).map(|k| k as f32 / steps) {
            let between = |from: f32, to: f32| from + (to - from) * t;
            let (left, right) =
                (between(pair[0].left_px, pair[1].left_px), between(pair[0].right_px, pair[1].right_px));
            let (mid, depth_m) =
                (pair[0].mid.lerp(pair[1].mid, t), between(pair[0].depth_m, pair[1].depth_m));
            let (first, last) = ((-left / STEP_PX).ceil() as i32, (right / STEP_PX) as i32);
            for away in (first..=last).map(|k| k as f32 * STEP_PX) {
                let Some(index) = mask.index_at(mid + pair[0].across * away) else { continue };
                let expected_m = depth_m + pair[0].slope_m * away;
                if mask.blobs.of[index] != 0 && (mask.depth_m[index] - expected_m).abs() < NEAR_M {
                    of[index] = label;
                }
            }
        }
    }
}

fn contours(outlines: &[Outline]) -> Vec<Polyline> {
    let point = |point: &Vec2| Point { x: point.x, y: point.y, half_width_left: 0.0, half_width_right: 0.0 };
    let contour = |(outline, label): (&Outline, u32)| Polyline {
        kind: PolylineKind::Contour,
        label,
        points: outline.points.iter().map(point).collect(),
    };
    outlines.iter().zip(1..).map(contour).collect()
}

/// As many of both as a preview holds, the longest contours first.
fn fitting(mut lines: Vec<Polyline>, mut contours: Vec<Polyline>) -> Vec<Polyline> {
    contours.sort_by_key(|contour| std::cmp::Reverse(contour.points.len()));
    lines.append(&mut contours);
    let is_line = |line: &Polyline| {
        let finite = |point: &Point| point.x.is_finite() && point.y.is_finite();
        let wide = |point: &Point| point.half_width_left.is_finite() && point.half_width_right.is_finite();
        line.points.len() >= 2 && line.points.iter().all(|point| finite(point) && wide(point))
    };
    lines.retain(is_line);
    let mut points = 0;
    let mut fits = |line: &Polyline| {
        points += line.points.len();
        points <= layout::layout::MAX_POINTS
    };
    let count = lines.iter().take(layout::layout::MAX_POLYLINES).take_while(|line| fits(line)).count();
    lines.truncate(count);
    lines
}

/// The frame thread's side: a look for each frame, of which readers see the newest.
#[derive(Debug)]
pub(crate) struct Previewer {
    looks: watch::Sender<Option<Arc<Look>>>,
    sequence: u64,
    visitor: Visitor,
    shown: Option<Arc<Shown>>,
}

impl Previewer {
    /// One that has shown nothing yet.
    pub(crate) fn new(looks: watch::Sender<Option<Arc<Look>>>) -> Self {
        Self { looks, sequence: 0, visitor: Visitor::default(), shown: None }
    }

    /// A source begins, maybe anew.
    pub(crate) fn begin(&mut self) {
        self.visitor = Visitor::default();
        self.shown = None;
    }

    /// Shows a frame that `session` has taken, and the capture that it completed. `is_known`: all of its blades
    /// were captured before. O(1).
    pub(crate) fn frame(
        &mut self,
        frame: Arc<DepthFrame>,
        session: &Session,
        capture: Option<Arc<Capture>>,
        is_known: bool,
    ) {
        let (state, timestamp_ns) = (session.state(), frame.timestamp_ns);
        let message = self.visitor.tell(state, capture.as_deref(), is_known, timestamp_ns);
        let is_captured = state == State::Captured;
        if !is_captured || capture.is_some() {
            self.shown = capture.filter(|_| is_captured).map(|capture| Arc::new(Shown::new(capture)));
        }
        let params = session.params();
        self.show(Look {
            sequence: self.sequence + 1,
            frame: Some((session.frames().saturating_sub(1), frame)),
            mask: params.pipeline.mask.clone(),
            state: match state {
                State::Waiting => layout::State::Waiting,
                State::Settling { .. } => layout::State::Settling,
                State::Captured => layout::State::Captured,
            },
            hold: state.hold(timestamp_ns, &params.station),
            message,
            shown: self.shown.clone(),
        });
    }

    /// Shows that no frames come, unless that is what is shown.
    pub(crate) fn no_source(&mut self, message: Message, mask: &MaskParams) {
        let is_shown = |look: &Arc<Look>| look.frame.is_none() && look.message == message;
        if self.looks.borrow().as_ref().is_some_and(is_shown) {
            return;
        }
        self.begin();
        self.show(Look {
            sequence: self.sequence + 1,
            frame: None,
            mask: mask.clone(),
            state: layout::State::NoSource,
            hold: 0.0,
            message,
            shown: None,
        });
    }

    fn show(&mut self, look: Look) {
        self.sequence = look.sequence;
        self.looks.send_replace(Some(Arc::new(look)));
    }
}

#[cfg(test)]
mod tests;
