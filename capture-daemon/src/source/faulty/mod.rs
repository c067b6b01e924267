//! A sensor that fails as it is told to: a recording, played over and over as a live one, with the faults of a script. It
//! runs in the sensor process like any other, so that the whole chain meets them.
//!
//! The sensor runs by itself from the moment at which its script was written, whether or not anybody opens it: frame k is
//! due k periods later, and a fault happens then to whichever process has the sensor open. A script that is written anew
//! begins anew, also for a process that has it open.
//!
//! ```toml
//! recording = "row-3.mcap"     # beside the script, or a whole path
//! [[fault]]
//! at_s = 4.0                   # after the script was written
//! kind = "unplug"              # see `Fault`
//! for_s = 1.5
//! ```

mod script;

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rand_pcg::Pcg32;
use rand_pcg::rand_core::RngCore;

pub use self::script::{Fault, FaultKind, Script};
use self::script::{Slot, State};
use super::SourceError;
use super::host::{Closed, Link, Message, Order};
use crate::frame::DepthFrame;
use crate::recording::{self, OpenOptions};

/// Most frames of the recording, since they are kept in memory.
const MAX_FRAMES: usize = 600;
/// How often a sensor that is not there is looked for.
const TICK: Duration = Duration::from_millis(20);
/// How often the daemon hears that it is waited for.
const SAY_MISSING_EVERY: Duration = Duration::from_millis(500);

/// The recording's frames, all of one size.
fn pictures(path: &Path) -> Result<Vec<DepthFrame>, String> {
    let mut source = recording::open(path, &OpenOptions::default()).map_err(|error| error.to_string())?;
    let mut pictures: Vec<DepthFrame> = Vec::new();
    while pictures.len() < MAX_FRAMES {
        match source.next_frame() {
            Ok(frame) => {
                let is_alike =
                    |first: &DepthFrame| (first.width, first.height) == (frame.width, frame.height);
                if pictures.first().is_none_or(is_alike) {
                    pictures.push(frame);
                }
            }
            Err(SourceError::BadFrame(_) | SourceError::Told(_) | SourceError::Interrupted(_)) => {}
            Err(SourceError::End) => break,
            Err(SourceError::Failed(reason)) => return Err(reason),
        }
    }
    Ok(pictures)
}

/// Frames each second, by the times of the first and the last.
fn rate_of(pictures: &[DepthFrame]) -> f64 {
    let times = || Some((pictures.first()?.timestamp_ns, pictures.last()?.timestamp_ns));
    let elapsed_s = times().map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9);
    if elapsed_s > 0.0 { ((pictures.len() - 1) as f64 / elapsed_s).clamp(1.0, 1000.0) } else { 30.0 }
}

/// Streams as the script says, until the sensor is gone.
///
/// # Errors
/// Why it cannot go on.
pub(super) fn stream(order: &Order, link: &mut Link) -> Result<Result<(), Closed>, String> {
    let path = order
        .sensor
        .device
        .as_deref()
        .ok_or("a faulty sensor needs sensor.device, the path of its script")?;
    let path = Path::new(path);
    let (script, written) = Script::read(path)?;
    let recording = path.parent().unwrap_or(Path::new(".")).join(&script.recording);
    let pictures = pictures(&recording)?;
    let fps = script.fps.unwrap_or_else(|| rate_of(&pictures));
    let mut sensor = Sensor { path: path.to_owned(), fps, script, written, pictures };
    let mut said: Option<Duration> = None;
    while let State::Absent = sensor.script.state(sensor.now_s()) {
        sensor.read_again();
        let now = sensor.elapsed();
        if said.is_none_or(|said| now.saturating_sub(said) >= SAY_MISSING_EVERY) {
            said = Some(now);
            if link.say(&Message::Missing("the faulty sensor is not plugged in".to_owned())).is_err() {
                return Ok(Err(Closed));
            }
        }
        std::thread::sleep(TICK);
    }
    sensor.stream(link)
}

struct Sensor {
    path: PathBuf,
    script: Script,
    /// When the script was written.
    written: SystemTime,
    pictures: Vec<DepthFrame>,
    fps: f64,
}

impl Sensor {
    fn elapsed(&self) -> Duration {
        SystemTime::now().duration_since(self.written).unwrap_or_default()
    }

    /// Whether the script was written anew, and is read. One that cannot be read changes nothing.
    fn read_again(&mut self) -> bool {
        let written = std::fs::metadata(&self.path).and_then(|metadata| metadata.modified());
        let is_new = written.is_ok_and(|written| written != self.written);
        let read = is_new.then(|| Script::read(&self.path).ok()).flatten();
        read.map(|(script, written)| (self.script, self.written) = (script, written)).is_some()
    }

    fn now_s(&self) -> f64 {
        self.elapsed().as_secs_f64()
    }

    fn stream(&mut self, link: &mut Link) -> Result<Result<(), Closed>, String> {
        let mut opened_s = self.now_s();
        let first = &self.pictures[0];
        let name = format!("faulty sensor, {}x{} {:.0}/s", first.width, first.height, self.fps);
        let said =
            link.say(&Message::Serial("F1".to_owned())).and_then(|()| link.say(&Message::Opened(name)));
        if said.is_err() {
            return Ok(Err(Closed));
        }
        let mut index = (opened_s * self.fps) as u64 + 1;
        let mut lost = 0;
        loop {
            // Beats of the state between frames too: it may be unplugged while it stalls.
            let due_s = self.script.due_s(index, self.fps);
            loop {
                let now_s = self.now_s();
                match self.script.happened(opened_s, now_s) {
                    State::Absent => return Err("the sensor was unplugged".to_owned()),
                    State::Reset => return Err("the sensor was reset, and is another device now".to_owned()),
                    State::Crashed => std::process::abort(),
                    State::Hung => loop {
                        std::thread::sleep(Duration::from_secs(1));
                    },
                    State::Streaming => {}
                }
                if now_s >= due_s {
                    break;
                }
                std::thread::sleep(Duration::from_secs_f64((due_s - now_s).min(TICK.as_secs_f64())));
            }
            let sent = match self.script.slot(index, self.fps) {
                Slot::Nothing => Ok(()),
                Slot::Lost => {
                    lost += 1;
                    Ok(())
                }
                slot => {
                    let told =
                        if lost > 0 { link.say(&Message::Lost(std::mem::take(&mut lost))) } else { Ok(()) };
                    told.and_then(|()| match self.frame(index, &slot) {
                        Ok(frame) => link.frame(frame),
                        Err(reason) => link.say(&Message::Bad(reason)),
                    })
                }
            };
            if sent.is_err() {
                return Ok(Err(Closed));
            }
            index += 1;
            if self.read_again() {
                opened_s = 0.0;
                index = (self.now_s() * self.fps) as u64 + 1;
            }
        }
    }

    /// The frame of a slot; or why its driver refuses it.
    fn frame(&self, index: u64, slot: &Slot) -> Result<DepthFrame, String> {
        let picture = |index: u64| &self.pictures[(index % self.pictures.len() as u64) as usize];
        let mut frame = picture(index).clone();
        let t_s = index as f64 / self.fps;
        let since_ns = self.written.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        let time_ns = since_ns as f64 + (t_s + self.script.clock_s(t_s)) * 1e9;
        // Whole microseconds, as sensors have them.
        frame.timestamp_ns = (time_ns / 1e3) as u64 * 1000;
        let mut random = Pcg32::new(index, 0x5ed);
        let noise_mm = self.script.noise_mm(t_s);
        if noise_mm > 0.0 {
            add_noise(&mut frame, noise_mm, &mut random);
        }
        match slot {
            Slot::Torn => {
                let row = 1 + random.next_u32() as usize % (frame.height - 1).max(1);
                let at = row * frame.width;
                frame.depth[at..].copy_from_slice(&picture(index.saturating_sub(7)).depth[at..]);
            }
            Slot::Zero => return Err("a frame without a single reading".to_owned()),
            // What its own process does not see: fewer bytes than it says.
            Slot::Short => frame.depth.truncate(frame.depth.len() / 2),
            Slot::Whole | Slot::Nothing | Slot::Lost => {}
        }
        Ok(frame)
    }
}

/// Makes readings noisy, of a standard deviation in millimetres; near enough to a normal distribution.
fn add_noise(frame: &mut DepthFrame, sigma_mm: f64, random: &mut Pcg32) {
    let counts = sigma_mm * 1e-3 / frame.depth_unit_m;
    // Of the sum of four numbers of 0 to 65535.
    let scale = counts / (65_536.0 * (4.0_f64 / 12.0).sqrt());
    for pixel in frame.depth.iter_mut().filter(|pixel| **pixel != 0) {
        let [a, b] = [random.next_u32(), random.next_u32()];
        let sum = f64::from(a >> 16) + f64::from(a & 0xffff) + f64::from(b >> 16) + f64::from(b & 0xffff);
        let moved = f64::from(*pixel) + (sum - 2.0 * 65_535.0) * scale;
        *pixel = moved.round().clamp(1.0, f64::from(u16::MAX)) as u16;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bar;

    fn sensor(faults: &str) -> Sensor {
        let script: Script = toml::from_str(&format!("recording = \"a\"\n{faults}")).expect("a script");
        let pictures = (0..10).map(|index| bar::frame(index, Some(500), 1300)).collect();
        Sensor {
            path: PathBuf::new(),
            script,
            written: UNIX_EPOCH + Duration::from_secs(1_700_000_000),
            pictures,
            fps: 10.0,
        }
    }

    #[test]
    fn frames_have_the_sensor_s_own_time_and_its_steps() {
        let sensor = sensor("[[fault]]\nat_s = 2.0\nkind = \"clock\"\nstep_s = -5.0\n");
        let time = |index| sensor.frame(index, &Slot::Whole).expect("a frame").timestamp_ns;
        assert_eq!(time(13), 1_700_000_001_300_000_000);
        assert_eq!(time(20), 1_699_999_997_000_000_000);
        assert_eq!(sensor.frame(13, &Slot::Whole).expect("a frame").depth, sensor.pictures[3].depth);
    }

    #[test]
    fn noise_rises_to_its_measure_and_spares_what_has_no_reading() {
        let mut sensor = sensor("[[fault]]\nat_s = 0.0\nkind = \"noise\"\nto_mm = 8.0\nfor_s = 4.0\n");
        sensor.pictures.iter_mut().for_each(|picture| picture.depth[0] = 0);
        let deviation = |index: u64| {
            let frame = sensor.frame(index, &Slot::Whole).expect("a frame");
            assert_eq!(frame.depth[0], 0);
            let clean = &sensor.pictures[index as usize % 10].depth;
            let pairs = frame.depth.iter().zip(clean).skip(1);
            let squares: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
            (squares / (clean.len() - 1) as f64).sqrt()
        };
        for (index, expected_mm) in [(10, 2.0), (20, 4.0), (39, 7.8)] {
            assert!((deviation(index) - expected_mm).abs() < 0.2, "{index}: {}", deviation(index));
        }
        assert_eq!(deviation(41), 0.0, "it is over");
    }

    #[test]
    fn a_torn_frame_ends_as_an_earlier_one_and_a_short_one_lacks_bytes() {
        let mut sensor = sensor("");
        for (index, picture) in (0..).zip(&mut sensor.pictures) {
            picture.depth.fill(1000 + index);
        }
        let torn = sensor.frame(8, &Slot::Torn).expect("a frame").depth;
        assert_eq!((torn.first(), torn.last()), (Some(&1008), Some(&1001)));
        let short = sensor.frame(8, &Slot::Short).expect("as its process has it");
        assert!(short.depth.len() < short.width * short.height);
        assert!(sensor.frame(8, &Slot::Zero).is_err());
    }
}
