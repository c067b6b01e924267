//! What is known of sensors by their kind, for those that do not say it of themselves: the unit of their depth, and about
//! how they see. A camera's own calibration is better, always: the keys of `[camera]` replace what stands here.

use crate::frame::CameraModel;
use crate::source::pixels::PixelFormat;

/// How counts become metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Counts {
    /// Each is so many metres.
    Metres(f64),
    /// They are disparities: z = `metres` / (`offset` − count), and no reading from `offset` on.
    Disparity {
        /// Base line times focal length times steps a pixel, metres.
        metres: f64,
        /// The count of what is infinitely far away.
        offset: f64,
    },
}

/// About how sensors of a kind see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// Columns and rows that `focal_px` is for.
    pub size: [usize; 2],
    /// Focal length at that size, pixels, along both axes.
    pub focal_px: f64,
    /// Columns of the smallest picture that is the whole picture made smaller (until it fills what is wanted; the rest
    /// is cut off); smaller ones are cut out. `None`: nothing is known of pictures of another shape.
    pub filled_from: Option<usize>,
    /// By how much a sensor's own focal length may differ, relative.
    pub tolerance: f64,
}

/// A kind of sensors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Its name: a value of `sensor.profile`.
    pub name: &'static str,
    /// USB vendors and products that it is known by.
    pub usb: &'static [(u16, u16)],
    /// Whether OpenNI2 reads it, through its USB node, and not the kernel.
    pub is_read_by_openni2: bool,
    /// The pixel format that is depth, where that cannot be told from the format.
    pub format: Option<PixelFormat>,
    /// What its counts are.
    pub counts: Counts,
    /// About how it sees.
    pub nominal: Nominal,
    /// Where the numbers are from.
    pub source: &'static str,
}

/// All kinds that something is known of. No sensor was at hand: every focal length is approximate.
pub const PROFILES: [Profile; 7] = [
    Profile {
        name: "realsense-d435",
        usb: &[(0x8086, 0x0b07), (0x8086, 0x0b3a)],
        is_read_by_openni2: false,
        format: None,
        counts: Counts::Metres(0.001),
        nominal: Nominal { size: [1280, 800], focal_px: 641.0, filled_from: Some(424), tolerance: 0.02 },
        source: "focal length: calibrations that owners of two D435 posted (librealsense issue 11511: 644.9 px at \
                 1280x720; issue 3474: 638.2 px, from 319.1 px at 640x360), which agree on how sizes are scaled; the angle of the \
                 datasheet (Intel 337029-009, table 3-42: 87 +-3 degrees) is that in which depth is given, and is less. \
                 Unit: librealsense issue 9494, by its support. USB: 99-realsense-libusb.rules of librealsense",
    },
    Profile {
        name: "realsense-d415",
        usb: &[(0x8086, 0x0ad3)],
        is_read_by_openni2: false,
        format: None,
        counts: Counts::Metres(0.001),
        nominal: Nominal { size: [1280, 720], focal_px: 989.0, filled_from: Some(424), tolerance: 0.08 },
        source: "focal length: from the angle across 720 rows in which depth is given, 40 +-1 degrees (Intel 337029-009, \
                 table 3-42, as quoted in bmegli/realsense-network-hardware-video-encoder issue 14); the lens may see more, \
                 as that of the D435 does. Unit: as the D435. USB: 99-realsense-libusb.rules of librealsense",
    },
    Profile {
        name: "realsense-l515",
        usb: &[(0x8086, 0x0b64)],
        is_read_by_openni2: false,
        format: None,
        counts: Counts::Metres(0.000_25),
        nominal: Nominal { size: [640, 480], focal_px: 457.0, filled_from: None, tolerance: 0.05 },
        source: "unit: librealsense issue 8058, confirmed by its support. Focal length: from the 70 degrees that the maker \
                 gives as its field of view, a number without a calibration to compare with. USB: 0b64 has no \
                 source at hand",
    },
    Profile {
        name: "realsense-sr300",
        usb: &[(0x8086, 0x0aa5), (0x8086, 0x0b48)],
        is_read_by_openni2: false,
        format: None,
        counts: Counts::Metres(0.000_125),
        nominal: Nominal { size: [640, 480], focal_px: 473.0, filled_from: None, tolerance: 0.05 },
        source: "unit: librealsense issues 1077 and 9494. Focal length: the calibration that an owner posted (librealsense \
                 issue 10838: 472.95 px at 640x480); its lens bends lines, too, which is not undone. USB: \
                 99-realsense-libusb.rules of librealsense; 0b48 (SR305) has no source at hand",
    },
    Profile {
        name: "xtion",
        usb: &[(0x1d27, 0x0600), (0x1d27, 0x0601), (0x1d27, 0x0609)],
        is_read_by_openni2: true,
        format: Some(PixelFormat::Y16),
        counts: Counts::Metres(0.001),
        nominal: Nominal { size: [640, 480], focal_px: 577.0, filled_from: None, tolerance: 0.03 },
        source: "focal length: from 58 degrees across, as its maker says (quoted in Stack Overflow question 14854107). Read \
                 by OpenNI2, which says angle and unit itself: no kernel driver gives its depth. USB: Debian's \
                 60-libopenni2-0.rules",
    },
    Profile {
        name: "kinect-v1",
        usb: &[(0x045e, 0x02ae), (0x045e, 0x02bf)],
        is_read_by_openni2: false,
        format: Some(PixelFormat::Y10B),
        // 0.075 m · 580 px · 8 steps a pixel, and half of that and of 1090 where the lowest of 11 bits is missing.
        counts: Counts::Disparity { metres: 174.0, offset: 545.0 },
        nominal: Nominal { size: [640, 480], focal_px: 580.0, filled_from: None, tolerance: 0.03 },
        source: "Konolige & Mihelich, Technical description of Kinect calibration (ROS kinect_calibration): z = b f / ((offset \
                 - count) / 8) with b 75 mm, f about 580 px, offset typically 1090 of 11 bits. The kernel's gspca_kinect \
                 (depth_mode=1) asks for 10 bits: that they are the upper ten is assumed. USB: the kernel's table",
    },
    Profile {
        name: "astra",
        usb: &[(0x2bc5, 0x0401), (0x2bc5, 0x0402), (0x2bc5, 0x0403), (0x2bc5, 0x0404)],
        is_read_by_openni2: true,
        format: Some(PixelFormat::Y16),
        counts: Counts::Metres(0.001),
        nominal: Nominal { size: [640, 480], focal_px: 575.0, filled_from: None, tolerance: 0.05 },
        source: "focal length: from 58.2 degrees across, which the maker says of the Astra 2 (datasheet 1.0): the Astra's own \
                 are between 58 and 60. Read by OpenNI2, which says angle and unit itself. USB: rules files that \
                 Orbbec's users pass on, 0401 to 0404",
    },
];

impl Profile {
    /// The profile of a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        PROFILES.iter().find(|profile| profile.name == name)
    }

    /// The profile of a USB device.
    pub fn of_usb(vendor: u16, product: u16) -> Option<&'static Self> {
        PROFILES.iter().find(|profile| profile.usb.contains(&(vendor, product)))
    }

    /// Names of all, for messages.
    pub fn names() -> String {
        PROFILES.map(|profile| profile.name).join(", ")
    }

    /// About the camera of a picture of `size`, columns and rows; none where it is not known how such a picture is cut from
    /// the whole one. The principal point is taken to be the middle.
    pub fn camera(&self, size: [usize; 2]) -> Option<CameraModel> {
        let Nominal { size: whole, focal_px, filled_from, .. } = self.nominal;
        let scales = [0, 1].map(|axis| size[axis] as f64 / whole[axis] as f64);
        let is_known = match filled_from {
            Some(columns) => size[0] >= columns,
            None => (scales[0] - scales[1]).abs() < 1e-9,
        };
        let focal_px = focal_px * scales[0].max(scales[1]);
        let [cx, cy] = size.map(|pixels| (pixels as f64 - 1.0) / 2.0);
        let camera = CameraModel { fx: focal_px, fy: focal_px, cx, cy };
        (is_known && camera.is_valid()).then_some(camera)
    }
}

impl Counts {
    /// Unit of what [`Self::convert`] leaves, metres.
    pub fn unit_m(self) -> f64 {
        match self {
            Self::Metres(unit_m) => unit_m,
            // To 6.5 m, and finer than any step of such a sensor before 1 m.
            Self::Disparity { .. } => 1e-4,
        }
    }

    /// Makes counts of a frame linear, in [`Self::unit_m`].
    pub fn convert(self, depth: &mut [u16]) {
        let Self::Disparity { metres, offset } = self else { return };
        for count in depth {
            let metres = metres / (offset - f64::from(*count));
            // A float becomes the nearest of u16's numbers.
            let counts = (metres / self.unit_m()).round();
            *count = if (1.0..=65535.0).contains(&counts) { counts as u16 } else { 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn focal(name: &str, size: [usize; 2]) -> Option<f64> {
        Profile::named(name).expect("a profile").camera(size).map(|camera| camera.fx)
    }

    #[test]
    fn a_profile_is_found_by_its_name_and_by_one_usb_number_alone() {
        let mut numbers: Vec<(u16, u16)> = Vec::new();
        for profile in &PROFILES {
            assert_eq!(Profile::named(profile.name), Some(profile));
            for (vendor, product) in profile.usb {
                assert_eq!(Profile::of_usb(*vendor, *product), Some(profile));
                numbers.push((*vendor, *product));
            }
            let Nominal { tolerance, .. } = profile.nominal;
            assert!((0.005..0.2).contains(&tolerance) && profile.source.len() > 50, "{}", profile.name);
        }
        let count = numbers.len();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), count);
        assert_eq!((Profile::named("d435"), Profile::of_usb(0x8086, 1)), (None, None));
    }

    #[test]
    fn sizes_of_a_d435_are_scaled_as_its_owners_calibrations_say() {
        // librealsense issue 11511 and realsense-ros issue 2788, each in units of its own focal length at 1280.
        for (size, of_whole) in [
            ([1280, 720], 644.920 / 644.920),
            ([848, 480], 427.260 / 644.920),
            ([640, 480], 384.207 / 640.346),
            ([640, 360], 320.173 / 640.346),
            ([480, 270], 240.130 / 640.346),
            ([424, 240], 212.115 / 640.346),
            ([848, 100], 424.229 / 640.346),
        ] {
            let found = focal("realsense-d435", size).expect("it is known") / 641.0;
            assert!((found - of_whole).abs() < 1e-4, "{size:?}: {found}, expected {of_whole}");
        }
        assert_eq!(focal("realsense-d435", [256, 144]), None, "it is cut out");
    }

    #[test]
    fn a_picture_of_another_shape_is_not_guessed() {
        assert_eq!(focal("realsense-sr300", [640, 480]), Some(473.0));
        assert_eq!(focal("realsense-l515", [1024, 768]), Some(457.0 * 1.6));
        assert_eq!(focal("realsense-sr300", [640, 240]), None);
    }

    #[test]
    fn disparities_of_a_kinect_become_tenths_of_millimetres() {
        let kinect = Profile::named("kinect-v1").expect("a profile");
        // In 11 bits: 348 m / (1090 - count).
        let mut depth = [371, 400, 544, 545, 1023, 0];
        kinect.counts.convert(&mut depth);
        assert_eq!(depth, [10_000, 12_000, 0, 0, 0, 3_193]);
        assert!((kinect.counts.unit_m() - 1e-4).abs() < 1e-12);
        let mut depth = [1, 2];
        Counts::Metres(0.001).convert(&mut depth);
        assert_eq!(depth, [1, 2]);
    }
}
