//! Whether the region of interest lies within the images that come.

/// Knows which region and size of images was looked at, so that each is told of once.
#[derive(Debug, Default)]
pub(crate) struct RegionWatch {
    seen: Option<([usize; 4], [usize; 2])>,
}

impl RegionWatch {
    /// What is to be said of `region` (`mask.roi`, pixels, half open) in images of `size` (columns and rows), once
    /// for each pair of them: nothing where it lies within.
    pub(crate) fn warning(&mut self, region: Option<[usize; 4]>, size: [usize; 2]) -> Option<String> {
        let looked_at = region.map(|region| (region, size));
        if looked_at == self.seen {
            return None;
        }
        self.seen = looked_at;
        beyond(region?, size)
    }
}

fn beyond(region: [usize; 4], [width, height]: [usize; 2]) -> Option<String> {
    let [x0, y0, x1, y1] = region;
    let consequence = if x0 >= width || y0 >= height {
        "lies outside of them, and nothing is seen"
    } else if x1 > width || y1 > height {
        "reaches beyond them, and is cut off there"
    } else {
        return None;
    };
    Some(format!(
        "the images have {width}x{height} pixels, and mask.roi = {region:?} {consequence}; expected [x0, y0, x1, y1] \
         with x1 up to {width} and y1 up to {height}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_beyond_the_images_is_told_of_once_for_each_size() {
        let mut watch = RegionWatch::default();
        assert_eq!(watch.warning(None, [640, 480]), None);
        assert_eq!(watch.warning(Some([0, 0, 640, 480]), [640, 480]), None);
        let smaller = watch.warning(Some([0, 0, 640, 480]), [512, 424]).expect("it is beyond");
        assert!(smaller.contains("512x424") && smaller.contains("mask.roi = [0, 0, 640, 480]"), "{smaller}");
        assert!(smaller.contains("cut off"), "{smaller}");
        assert_eq!(watch.warning(Some([0, 0, 640, 480]), [512, 424]), None);
        let outside = watch.warning(Some([10, 424, 20, 430]), [512, 424]).expect("it is outside");
        assert!(outside.contains("nothing is seen"), "{outside}");
        assert_eq!(watch.warning(None, [512, 424]), None);
        assert!(watch.warning(Some([10, 424, 20, 430]), [512, 424]).is_some());
    }
}
