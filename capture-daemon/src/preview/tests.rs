//! A look becomes the bytes that it should.

use super::*;
use crate::bar;
use crate::session::SessionParams;

/// A frame of an upright blade, half a metre away; its first pixel has no reading.
fn frame(index: u64, depth_unit_m: f64) -> DepthFrame {
    let mut frame = bar::frame(index, Some(500), 1300);
    let counts = |mm: u16| (f64::from(mm) * 1e-3 / depth_unit_m).round() as u16;
    frame.depth.iter_mut().for_each(|depth| *depth = counts(*depth));
    frame.depth[0] = 0;
    DepthFrame { depth_unit_m, ..frame }
}

/// The looks at so many frames.
fn looks(frames: u64, depth_unit_m: f64) -> Vec<Arc<Look>> {
    let (looks, seen) = watch::channel(None);
    let mut previewer = Previewer::new(looks);
    let mut session = Session::new(SessionParams::default());
    let look = |index| {
        let frame = frame(index, depth_unit_m);
        let capture = session.push(&frame).map(Arc::new);
        previewer.frame(Arc::new(frame), &session, capture, false);
        seen.borrow().clone().expect("it is shown")
    };
    (0..frames).map(look).collect()
}

fn read(look: &Look) -> layout::Preview<Vec<u8>> {
    layout::Preview::validate(look.encode().expect("it is small")).expect("valid")
}

#[test]
fn a_look_is_numbered_and_tells_what_the_session_does() {
    let looks = looks(30, 0.001);
    for (look, index) in looks.iter().zip(0_u64..) {
        let preview = read(look);
        let header = preview.header();
        assert_eq!((header.sequence, header.frame), (index + 1, index));
        assert_eq!(header.timestamp_ns, 1_000_000_000 + index * 33_333_333);
        assert_eq!((header.width, header.height, header.camera_px), (160, 120, [140.0, 140.0, 79.5, 59.5]));
        let (state, code) = if index < 16 {
            (layout::State::Settling, "hold_still")
        } else {
            (layout::State::Captured, "captured")
        };
        assert_eq!((header.state, preview.code()), (state, code), "frame {index}");
        assert_eq!(
            header.capture.map(|capture| (capture.frame, capture.blades)),
            (index >= 16).then_some((16, 1))
        );
        let seen = preview.mask().iter().filter(|bits| **bits == layout::SEEN).count();
        assert_eq!(
            seen,
            look.frame.as_ref().map_or(0, |(_, f)| f.depth.iter().filter(|d| **d == 500).count())
        );
    }
    let skeletons = |look: &Look| {
        read(look)
            .polylines()
            .filter(|line| line.kind() == PolylineKind::Skeleton)
            .map(|line| line.label())
            .collect()
    };
    let [before, after]: [Vec<u32>; 2] = [skeletons(&looks[15]), skeletons(&looks[16])];
    assert_eq!((before, after), (vec![], vec![1]));
    assert!(Arc::ptr_eq(looks[16].shown.as_ref().expect("shown"), looks[29].shown.as_ref().expect("shown")));
}

#[test]
fn every_pixel_of_the_blade_is_of_its_part() {
    let look = looks(17, 0.001).pop().expect("a look");
    let preview = read(&look);
    let pixels: Vec<(u16, u8)> = preview.depth_mm().zip(preview.labels().iter().copied()).collect();
    let of_blade: Vec<u8> =
        pixels.iter().filter(|(depth, _)| *depth == 500).map(|(_, label)| *label).collect();
    assert!(of_blade.len() > 400 && of_blade.iter().all(|label| *label == 1));
    assert!(pixels.iter().all(|(depth, label)| *depth == 500 || *label == 0));
}

#[test]
fn what_is_taken_away_is_shown_where_it_is() {
    let (looks, seen) = watch::channel(None);
    let mut previewer = Previewer::new(looks);
    let mut session = Session::new(SessionParams::default());
    for index in 0..60_usize {
        // From the capture on, two pixels to the right with each frame.
        let shift = 2 * index.saturating_sub(16);
        let mut frame = frame(index as u64, 0.001);
        for row in frame.depth.chunks_mut(160) {
            row.rotate_right(shift.min(60));
        }
        let capture = session.push(&frame).map(Arc::new);
        let depth = frame.depth.clone();
        previewer.frame(Arc::new(frame), &session, capture, false);
        let preview = read(seen.borrow().as_ref().expect("it is shown"));
        assert_eq!(preview.header().capture.is_some(), index >= 16);
        let is_blade = |at: usize| depth[at] == 500;
        assert!((0..depth.len()).all(|at| (preview.mask()[at] & layout::SEEN != 0) == is_blade(at)));
        let contours = preview.polylines().filter(|line| line.kind() == PolylineKind::Contour);
        let points: Vec<_> = contours.flat_map(|line| line.points().collect::<Vec<_>>()).collect();
        assert!(points.len() > 100, "frame {index}");
        for point in points {
            let (x, y) = (point.x.round() as usize, point.y.round() as usize);
            let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| y * 160 + x));
            assert!(around.clone().any(is_blade), "frame {index}: {point:?}");
        }
        let parts = preview.labels().iter().filter(|label| **label == 1).count();
        let skeletons = preview.polylines().filter(|line| line.kind() == PolylineKind::Skeleton).count();
        // Up to eight pixels wide, it lies beside where it was after four frames.
        match index {
            16 | 17 => assert!(parts > 400 && skeletons == 1, "frame {index}: {parts} {skeletons}"),
            0..16 | 20.. => assert_eq!((parts, skeletons), (0, 0), "frame {index}"),
            _ => assert_eq!(parts > 0, skeletons > 0, "frame {index}"),
        }
    }
}

#[test]
fn depth_is_told_in_millimetres_whatever_the_sensor_counts() {
    for depth_unit_m in [0.001, 0.0001, 0.00025, 0.002] {
        let look = looks(1, depth_unit_m).pop().expect("a look");
        let depth: Vec<u16> = read(&look).depth_mm().collect();
        assert_eq!((depth[0], depth[1], depth[60 * 160 + 80]), (0, 1300, 500), "{depth_unit_m}");
    }
    let mut tiny = frame(0, 0.0001);
    tiny.depth[1] = 1;
    assert_eq!(depth_mm(&tiny)[1], 1, "a reading stays one");
}

#[test]
fn a_frame_of_another_size_is_shown_without_the_capture() {
    let look = looks(17, 0.001).pop().expect("a look");
    let (width, height) = (80, 60);
    let small = DepthFrame { width, height, depth: vec![500; width * height], ..frame(17, 0.001) };
    let preview = read(&Look { frame: Some((17, Arc::new(small))), ..Look::clone(&look) });
    assert_eq!(preview.header().width, 80);
    assert!(preview.polylines().all(|line| line.kind() == PolylineKind::Contour));
    assert!(preview.labels().iter().all(|label| *label == 0));
}

#[test]
fn that_no_frames_come_is_told_once() {
    let (looks, seen) = watch::channel(None);
    let mut previewer = Previewer::new(looks);
    let mask = MaskParams::default();
    let mut told = |message| {
        previewer.no_source(message, &mask);
        seen.borrow().as_ref().map_or(0, |look: &Arc<Look>| look.sequence)
    };
    let messages = [Message::Reconnecting, Message::Reconnecting, Message::CallStaff, Message::CallStaff];
    assert_eq!(messages.map(&mut told), [1, 1, 2, 2]);
    let preview = read(seen.borrow().as_ref().expect("a look"));
    assert_eq!((preview.header().state, preview.header().width), (layout::State::NoSource, 0));
    assert_eq!(preview.code(), "call_staff");
}

#[test]
fn what_does_not_fit_is_left_out_contours_first() {
    let point = Point { x: 1.0, y: 2.0, half_width_left: 0.0, half_width_right: 0.0 };
    let line = |kind, points: usize| Polyline { kind, label: 0, points: vec![point; points] };
    let contour = |points| line(PolylineKind::Contour, points);
    let skeleton = line(PolylineKind::Skeleton, 128);
    let sizes = |lines: Vec<Polyline>| lines.iter().map(|line| line.points.len()).collect::<Vec<_>>();
    let all = layout::layout::MAX_POINTS;
    let fitted =
        fitting(vec![skeleton.clone()], vec![contour(3), contour(all - 200), contour(100), contour(1)]);
    assert_eq!(sizes(fitted), [128, all - 200], "the longest first, and no line of one point");
    let mut nowhere = contour(5);
    nowhere.points[3].x = f32::NAN;
    assert_eq!(sizes(fitting(vec![skeleton], vec![nowhere, contour(4)])), [128, 4]);
    let many = fitting(Vec::new(), vec![contour(2); 5000]);
    assert_eq!(many.len(), layout::layout::MAX_POLYLINES);
}
