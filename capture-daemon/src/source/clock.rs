//! A sensor's own time, as nanoseconds since 1970.

use std::time::{SystemTime, UNIX_EPOCH};

/// The system's time, nanoseconds since 1970.
pub(super) fn unix_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_nanos() as u64)
}

/// Turns a sensor's time into nanoseconds since 1970: its clock counts from anywhere, and may begin again. Distances in time
/// are those of the sensor, also when the system's clock is set meanwhile.
#[derive(Debug, Default)]
pub(super) struct SensorClock {
    offset_ns: Option<i128>,
    last_ns: u64,
}

impl SensorClock {
    /// When a frame was taken that the sensor stamped with `sensor_ns`, nanoseconds since 1970; later than the frame
    /// before. `unix_ns` says when that is on the system's clock: it is asked at the first frame, and whenever the sensor's
    /// clock went back.
    pub(super) fn time(&mut self, sensor_ns: i128, unix_ns: impl FnOnce() -> u64) -> u64 {
        let by = |offset: i128| u64::try_from(sensor_ns + offset).unwrap_or(0);
        let time = self.offset_ns.map(by).filter(|time| *time > self.last_ns);
        let time = time.unwrap_or_else(|| {
            let now = unix_ns().max(self.last_ns + 1);
            self.offset_ns = Some(i128::from(now) - sensor_ns);
            now
        });
        self.last_ns = time;
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_s_clock_goes_on_when_it_begins_again() {
        let mut clock = SensorClock::default();
        let unused = || panic!("the sensor's clock goes on");
        assert_eq!(clock.time(5_000_000_000, || 1_000), 1_000);
        assert_eq!(clock.time(5_033_333_000, unused), 33_334_000);
        assert_eq!(clock.time(0, || 66_000_000), 66_000_000, "it began again");
        assert_eq!(clock.time(33_333_000, unused), 99_333_000);
        assert_eq!(clock.time(0, || 5), 99_333_001, "time does not go back");
    }
}
