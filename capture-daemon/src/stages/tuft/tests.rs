//! Where gathering has to end.

use super::*;
use crate::stages::mask::{Labels, Region};
use crate::stages::section::{Fold, Measured, Middle};

const DEPTH_M: f32 = 0.5;

/// A mask with one blob: columns and rows, half open.
fn mask(columns: Range<usize>, rows: Range<usize>) -> Mask {
    let (width, height) = (300, 260);
    let seen = [columns.start, rows.start, columns.end, rows.end];
    let is_inside = |i: usize| columns.contains(&(i % width)) && rows.contains(&(i / width));
    let inside: Vec<bool> = (0..width * height).map(is_inside).collect();
    let area_px = columns.len() * rows.len();
    let labels = Labels {
        of: inside.iter().map(|inside| u16::from(*inside)).collect(),
        regions: vec![Region { label: 1, area_px, bounds: seen }],
    };
    Mask {
        width,
        height,
        region: [0, 0, width, height],
        seen,
        frames: 8,
        occupancy: inside.iter().map(|inside| f32::from(u8::from(*inside))).collect(),
        unseen: vec![false; width * height],
        depth_m: inside.iter().map(|inside| if *inside { DEPTH_M } else { 0.0 }).collect(),
        outside_m: Vec::new(),
        depth_noise_m: 0.0,
        hand: vec![false; width * height],
        blobs: labels.clone(),
        pieces: labels,
    }
}

/// A straight ribbon of 60 px whose root end lies at `from` and leads to `to`.
fn ribbon(from: Vec2, to: Vec2) -> Ribbon {
    let along = (to - from).normalize();
    let section = |i: u8| Section {
        expected: Expected {
            mid: from - along * f32::from(i),
            across: along.perp(),
            half_px: 3.0,
            depth_m: DEPTH_M,
            slope_m: 0.0,
            fold: Fold::default(),
            tolerance_m: 0.01,
            search_px: 3.0,
        },
        measured: Measured {
            middle: Middle::Blade,
            left_px: Some(-3.0),
            right_px: Some(3.0),
            depth_m: Some(DEPTH_M),
            readings: 5,
            slope_moments: [0.0; 2],
        },
        anchor: 0.0,
        guide_px: None,
    };
    Ribbon { sections: (0..60).map(section).collect(), root: End::Free, tip: End::Free, unsure: 0 }
}

/// Two blades that lead to one point from both sides, over nothing; the lower end of what is seen there
/// lies so far below that neither leads to it. Looking for such a base again and again never ended.
#[test]
fn a_base_that_no_blade_leads_to_ends_the_gathering() {
    let mask = mask(145..156, 195..226);
    let meet = Vec2::new(150.0, 205.0);
    let mut ribbons = [60.0, 240.0].map(|x| ribbon(Vec2::new(x, 196.0), meet));
    let blades: Vec<Blade> = ribbons.iter().enumerate().filter_map(blade).collect();
    let params = RibbonParams::default();
    let ground = Ground::Lowest(Lowest::of(&mask, params.down));
    let hub = hub(&mask, &blades, &ground, params.down).expect("they lead to a base");
    assert!(blades.iter().all(|blade| blade.leads_to(meet) > 0.9));
    assert!(blades.iter().all(|blade| blade.leads_to(hub.at) == 0.0), "{}", hub.at);

    let before = ribbons.clone();
    gather(&mask, &mut ribbons, &ground, &params);
    assert!(ribbons.iter().zip(&before).all(|(ribbon, before)| ribbon.sections == before.sections));
    assert!(ribbons.iter().all(|ribbon| ribbon.root == End::Free), "none is led over nothing");
}
