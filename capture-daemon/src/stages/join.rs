//! Fragments of one blade, parted by a gap without readings or by a fold, put together again.

use super::mask::Mask;
use super::ribbon::{End, Ribbon, RibbonParams, Section, reverse};
use super::section::{Measured, Middle};

/// Appends to each ribbon the fragment that carries it on past a gap without readings or a fold in
/// depth, as long as there is one.
pub(super) fn join(mask: &Mask, ribbons: &mut Vec<Ribbon>, params: &RibbonParams) {
    let mut i = 0;
    while i < ribbons.len() {
        let candidates = (0..ribbons.len()).filter(|k| *k != i);
        let ways = candidates.flat_map(|k| [(k, false), (k, true)]);
        let best = ways
            .filter_map(|(k, turned)| {
                Some((gap_px(mask, &ribbons[i], &ribbons[k], turned, params)?, k, turned))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, k, turned)) = best else {
            i += 1;
            continue;
        };
        let mut fragment = ribbons[k].clone();
        if turned {
            reverse(&mut fragment.sections);
            std::mem::swap(&mut fragment.root, &mut fragment.tip);
        }
        let ribbon = &mut ribbons[i];
        bridge(&mut ribbon.sections, fragment.sections[0]);
        ribbon.sections.extend(fragment.sections);
        ribbon.tip = fragment.tip;
        ribbons.remove(k);
        i -= usize::from(k < i);
    }
}

/// Sections about a pixel apart from the last one to `to`.
pub(super) fn bridge(sections: &mut Vec<Section>, to: Section) {
    let from = sections[sections.len() - 1];
    let steps = from.expected.mid.distance(to.expected.mid) as usize;
    for k in 1..steps {
        let t = k as f32 / steps as f32;
        let between = |a: f32, b: f32| a + (b - a) * t;
        let (a, b) = (&from.expected, &to.expected);
        let mut section = from;
        section.expected.mid = a.mid.lerp(b.mid, t);
        section.expected.half_px = between(a.half_px, b.half_px);
        section.expected.depth_m = between(a.depth_m, b.depth_m);
        section.measured = Measured::nothing(Middle::Unseen);
        sections.push(section);
    }
}

/// The gap from the tip of `ribbon` to the beginning (`turned`: the end) of `fragment`, pixels, if the
/// one carries on the other.
fn gap_px(
    mask: &Mask,
    ribbon: &Ribbon,
    fragment: &Ribbon,
    turned: bool,
    params: &RibbonParams,
) -> Option<f32> {
    const FOLD_PX: f32 = 4.0;
    let near_end = if turned { fragment.tip } else { fragment.root };
    if ribbon.tip == End::Shared || near_end == End::Shared {
        return None;
    }
    let n = ribbon.sections.len();
    let m = fragment.sections.len();
    let at = |k: usize| fragment.sections[if turned { m - 1 - k } else { k }].expected;
    let (tip, start) = (ribbon.sections[n - 1].expected, at(0));
    let gap = start.mid - tip.mid;
    let distance = gap.length();
    // Most are too far off.
    if distance > params.unseen_px as f32 {
        return None;
    }
    let out = (tip.mid - ribbon.sections[n - 1 - 8.min(n - 1)].expected.mid).normalize_or_zero();
    let onward = (at(8.min(m - 1)).mid - start.mid).normalize_or_zero();
    let straight = out.dot(onward) > 0.2 && (distance < FOLD_PX || gap.dot(out) > 0.6 * distance);
    let depth_near = (tip.depth_m - start.depth_m).abs() < 0.020 + 0.002 * distance;
    let alike = start.half_px < 2.5 * tip.half_px + 2.0;
    let steps = distance.ceil() as usize;
    let open = || {
        (0..=steps)
            .filter_map(|k| mask.index_at(tip.mid.lerp(start.mid, k as f32 / steps.max(1) as f32)))
            .filter(|index| !mask.unseen[*index] && mask.blobs.of[*index] == 0)
            .count()
    };
    let dark = || distance < FOLD_PX || (open() as f32) < 0.4 * distance;
    (straight && depth_near && alike && dark()).then_some(distance)
}
