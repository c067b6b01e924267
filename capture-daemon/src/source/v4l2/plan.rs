//! What is to be streamed, and what its counts and pixels mean: pure, from modes, profile and configuration.

use std::fmt;

use crate::config::SensorConfig;
use crate::frame::{CameraModel, DepthFrame};
use crate::source::host::Order;
use crate::source::pixels::PixelFormat;
use crate::source::profile::{Counts, Profile};

/// A mode of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mode {
    /// Its pixels.
    pub(super) format: PixelFormat,
    /// Columns and rows.
    pub(super) size: [usize; 2],
    /// Frames each second; `None`: the driver does not say.
    pub(super) fps: Option<u32>,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.size[0], self.size[1])?;
        self.fps.map_or(Ok(()), |fps| write!(f, " {fps}/s"))?;
        write!(f, " {}", self.format)
    }
}

/// How a sensor is streamed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    /// The mode.
    pub(super) mode: Mode,
    /// What counts are.
    counts: Counts,
    /// The camera of frames as they are handed on.
    camera: CameraModel,
    /// Whether left and right are to be exchanged.
    is_flipped: bool,
    /// The profile that the camera is of, where the configuration gives none.
    pub(super) approximate: Option<&'static Profile>,
}

/// The format that is wanted, or else the one that is depth.
fn format_of(
    modes: &[Mode],
    profile: Option<&Profile>,
    wanted: Option<PixelFormat>,
) -> Result<PixelFormat, String> {
    let has = |format: PixelFormat| modes.iter().any(|mode| mode.format == format);
    let given = || {
        let given: Vec<String> = PixelFormat::ALL
            .into_iter()
            .filter(|format| has(*format))
            .map(|format| format.to_string())
            .collect();
        given.join(", ")
    };
    if let Some(wanted) = wanted {
        let missing = || format!("it gives no {wanted}, which sensor.format asks for, but {}", given());
        return has(wanted).then_some(wanted).ok_or_else(missing);
    }
    let of_profile = profile.and_then(|profile| profile.format).filter(|format| has(*format));
    let of_depth = PixelFormat::ALL.into_iter().find(|format| format.is_depth() && has(*format));
    if let Some(format) = of_depth.or(of_profile) {
        return Ok(format);
    }
    if modes.is_empty() {
        return Err("it gives no depth".to_owned());
    }
    Err(format!(
        "it gives {}, which may be depth or infrared; where it is depth, say so with sensor.format",
        given()
    ))
}

/// The mode that fits what is wanted: of several the one nearest to 640×480 at 30 a second.
fn choose(modes: &[Mode], format: PixelFormat, wanted: &SensorConfig) -> Option<Mode> {
    let fits = |mode: &&Mode| {
        mode.format == format
            && wanted.size.is_none_or(|size| size == mode.size)
            && (wanted.fps.is_none() || wanted.fps == mode.fps)
    };
    let distance = |mode: &&Mode| {
        let [width, height] = mode.size;
        ((width * height).abs_diff(640 * 480), mode.fps.unwrap_or(30).abs_diff(30))
    };
    modes.iter().filter(fits).min_by_key(distance).copied()
}

impl Plan {
    /// How to stream a node with these modes.
    ///
    /// # Errors
    /// What is missing, and which key gives it.
    pub(super) fn new(
        modes: &[Mode],
        profile: Option<&'static Profile>,
        order: &Order,
    ) -> Result<Self, String> {
        let sensor = &order.sensor;
        let format = format_of(modes, profile, sensor.format)?;
        let mode = choose(modes, format, sensor).ok_or_else(|| {
            let modes: Vec<String> = modes.iter().map(Mode::to_string).collect();
            format!("the sensor has no such mode, but {}; see the keys of [sensor]", modes.join(", "))
        })?;
        let given = sensor.depth_unit_m.map(Counts::Metres);
        let counts = given.or_else(|| profile.map(|profile| profile.counts)).ok_or_else(|| {
            format!(
                "V4L2 does not say how much a count of depth is, and no profile fits this sensor; give sensor.depth_unit_m \
                 (0.001 for millimetres), or sensor.profile, one of {}",
                Profile::names()
            )
        })?;
        let of_kind = || profile.and_then(|profile| Some((profile.camera(mode.size)?, profile)));
        let (camera, approximate) = match (order.camera(), of_kind()) {
            (Some(camera), _) => (camera, None),
            (None, Some((camera, profile))) => (camera, Some(profile)),
            (None, None) => return Err(without_camera(profile, mode.size)),
        };
        Ok(Self { mode, counts, camera, is_flipped: sensor.mirror, approximate })
    }

    /// Metres of one count of the frames.
    pub(super) fn unit_m(&self) -> f64 {
        self.counts.unit_m()
    }

    /// The frame of a driver's bytes, whose rows begin `stride` bytes after each other.
    ///
    /// # Errors
    /// Why they are none.
    pub(super) fn develop(
        &self,
        bytes: &[u8],
        stride: usize,
        timestamp_ns: u64,
    ) -> Result<DepthFrame, String> {
        let [width, height] = self.mode.size;
        let depth = self.mode.format.depth(bytes, self.mode.size, stride);
        let mut depth = depth.map_err(|error| error.to_string())?;
        self.counts.convert(&mut depth);
        if self.is_flipped {
            depth.chunks_exact_mut(width).for_each(<[u16]>::reverse);
        }
        if depth.iter().all(|pixel| *pixel == 0) {
            return Err("a frame without a single reading".to_owned());
        }
        // The principal point of a kind is the middle, and stays there when left and right are exchanged.
        Ok(DepthFrame {
            width,
            height,
            depth,
            depth_unit_m: self.unit_m(),
            timestamp_ns,
            camera: self.camera,
        })
    }
}

/// What to tell where the lens is not known.
fn without_camera(profile: Option<&Profile>, [width, height]: [usize; 2]) -> String {
    let why = profile.map_or_else(
        || format!("no profile fits this sensor (sensor.profile takes one of {})", Profile::names()),
        |profile| format!("the profile {} does not know them at {width}x{height}", profile.name),
    );
    format!(
        "V4L2 does not say the camera's intrinsics, and {why}; give camera.fx, camera.fy, camera.cx and camera.cy in pixels, as \
         the sensor's own tool prints them or a calibration finds them (for a RealSense, rs-enumerate-devices -c)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::host::Task;

    const fn mode(format: PixelFormat, size: [usize; 2], fps: u32) -> Mode {
        Mode { format, size, fps: Some(fps) }
    }

    const MODES: [Mode; 5] = [
        mode(PixelFormat::Y16, [640, 480], 30),
        mode(PixelFormat::Z16, [1280, 720], 30),
        mode(PixelFormat::Z16, [640, 480], 90),
        mode(PixelFormat::Z16, [640, 480], 30),
        mode(PixelFormat::Z16, [848, 480], 60),
    ];

    fn order(sensor: SensorConfig, camera: Option<[f64; 4]>) -> Order {
        Order { camera, task: Task::Stream, sensor }
    }

    fn d435() -> Option<&'static Profile> {
        Profile::named("realsense-d435")
    }

    fn plan(modes: &[Mode], profile: Option<&'static Profile>, sensor: SensorConfig) -> Result<Plan, String> {
        Plan::new(modes, profile, &order(sensor, None))
    }

    #[test]
    fn depth_at_the_usual_size_is_taken_and_what_is_wanted_before_that() {
        let any = SensorConfig::default;
        let chosen = |sensor| plan(&MODES, d435(), sensor).map(|plan| plan.mode);
        assert_eq!(chosen(any()), Ok(MODES[3]));
        assert_eq!(chosen(SensorConfig { size: Some([848, 480]), ..any() }), Ok(MODES[4]));
        assert_eq!(chosen(SensorConfig { fps: Some(90), ..any() }), Ok(MODES[2]));
        assert_eq!(chosen(SensorConfig { format: Some(PixelFormat::Y16), ..any() }), Ok(MODES[0]));
        let none = chosen(SensorConfig { size: Some([640, 400]), ..any() }).expect_err("no such size");
        assert!(none.contains("1280x720 30/s Z16") && none.contains("[sensor]"), "{none}");
        let none =
            chosen(SensorConfig { format: Some(PixelFormat::Inzi), ..any() }).expect_err("no such format");
        assert!(none.contains("sensor.format") && none.contains("Z16, Y16"), "{none}");
    }

    #[test]
    fn what_may_be_infrared_is_taken_only_where_it_is_said_to_be_depth() {
        let modes = [MODES[0]];
        let doubt = plan(&modes, None, SensorConfig::default()).expect_err("it may be infrared");
        assert!(doubt.contains("Y16") && doubt.contains("sensor.format"), "{doubt}");
        let astra =
            plan(&modes, Profile::named("astra"), SensorConfig::default()).expect("its kind is known");
        assert_eq!(astra.mode, MODES[0]);
        assert!(plan(&[], None, SensorConfig::default()).expect_err("nothing").contains("no depth"));
    }

    #[test]
    fn what_no_profile_says_is_asked_for_by_its_key() {
        let modes = [MODES[3]];
        let unit = plan(&modes, None, SensorConfig::default()).expect_err("no unit");
        assert!(unit.contains("sensor.depth_unit_m") && unit.contains("realsense-l515"), "{unit}");
        let in_mm = SensorConfig { depth_unit_m: Some(0.001), ..SensorConfig::default() };
        let camera = plan(&modes, None, in_mm.clone()).expect_err("no camera");
        for words in
            ["camera.fx, camera.fy, camera.cx and camera.cy", "rs-enumerate-devices", "sensor.profile"]
        {
            assert!(camera.contains(words), "{camera}");
        }
        let odd = [mode(PixelFormat::Z16, [640, 240], 30)];
        let camera = plan(&odd, Profile::named("realsense-sr300"), in_mm.clone()).expect_err("another shape");
        assert!(camera.contains("realsense-sr300 does not know them at 640x240"), "{camera}");
        let given =
            Plan::new(&odd, None, &order(in_mm, Some([400.0, 401.0, 320.0, 121.0]))).expect("all is given");
        assert_eq!((given.camera.fy, given.approximate, given.unit_m()), (401.0, None, 0.001));
    }

    #[test]
    fn the_configuration_comes_before_the_profile() {
        let plan = |sensor, camera| Plan::new(&MODES, d435(), &order(sensor, camera)).expect("a plan");
        let of_kind = plan(SensorConfig::default(), None);
        assert!((of_kind.camera.fx - 384.6).abs() < 0.01 && of_kind.approximate == d435(), "{of_kind:?}");
        let in_tenths = SensorConfig { depth_unit_m: Some(0.0001), ..SensorConfig::default() };
        let given = plan(in_tenths, Some([390.0, 391.0, 310.0, 235.0]));
        assert_eq!((given.camera.fx, given.unit_m(), given.approximate), (390.0, 0.0001, None));
    }

    #[test]
    fn frames_are_unpacked_turned_and_checked() {
        let small = [mode(PixelFormat::Z16, [2, 2], 30)];
        let sensor = SensorConfig { depth_unit_m: Some(0.001), mirror: true, ..SensorConfig::default() };
        let plan =
            Plan::new(&small, None, &order(sensor, Some([2.0, 2.0, 0.25, 0.5]))).expect("all is given");
        let frame = plan.develop(&[1, 0, 2, 0, 9, 9, 3, 0, 4, 0], 6, 77).expect("a frame");
        assert_eq!((frame.depth, frame.timestamp_ns, frame.camera.cx), (vec![2, 1, 4, 3], 77, 0.25));
        assert!(plan.develop(&[1; 9], 6, 0).expect_err("too short").contains("9 bytes, expected 10"));
        assert!(plan.develop(&[0; 10], 6, 0).expect_err("all zero").contains("without a single reading"));
    }
}
