//! The verb `devices`: the sensors that are plugged in. They are listed by a process of its own, as they are streamed
//! by one: a driver that hangs is left to itself.

use std::fmt::Write as _;
use std::time::Duration;

use common::sentence::print;

use crate::cli::DevicesArgs;
use crate::config::{self, SensorConfig, SensorDriver};
use crate::source::host::{self, Message, Order, ReceiveError, Task};
use crate::source::listed::Listed;

/// How long a driver may take; the message of [`DevicesError::Silent`] says it, too.
const DEADLINE: Duration = Duration::from_secs(20);
/// All that are asked.
const DRIVERS: [SensorDriver; 2] = [SensorDriver::OpenNi2, SensorDriver::V4l2];

/// Why the sensors cannot be listed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DevicesError {
    /// The driver refuses, or is not there.
    #[error("{0}")]
    Refused(String),
    /// It takes too long.
    #[error("{0} does not list its devices within 20 s; unplug the sensor and plug it in again")]
    Silent(&'static str),
}

/// Prints the sensors. A driver that cannot list them is warned of, unless the configuration names it.
///
/// # Errors
/// When the configuration is not valid, its driver or none at all can list them, or stdout cannot be written.
pub fn devices(args: &DevicesArgs) -> anyhow::Result<()> {
    let config = config::load(args.config.config.as_deref(), &args.config.sets)?;
    let (mut devices, mut failed) = (Vec::new(), Vec::new());
    for (driver, list) in DRIVERS.map(|driver| (driver, list(driver, &config.sensor))) {
        match list {
            Ok(list) => devices.extend(list),
            Err(error) if config.sensor.driver == Some(driver) => return Err(error.into()),
            Err(error) => failed.push(error),
        }
    }
    for error in &failed {
        tracing::warn!("{error}");
    }
    if failed.len() == DRIVERS.len() {
        return Err(failed.remove(0).into());
    }
    if args.json {
        return Ok(print(&format!("{}\n", serde_json::to_string(&devices)?))?);
    }
    Ok(print(&page(&devices))?)
}

/// What a driver lists.
fn list(driver: SensorDriver, sensor: &SensorConfig) -> Result<Vec<Listed>, DevicesError> {
    let sensor = SensorConfig { driver: Some(driver), ..sensor.clone() };
    let order = Order { task: Task::List, camera: None, sensor };
    let mut process = host::start(None, &order).map_err(|error| DevicesError::Refused(error.to_string()))?;
    match process.receive(DEADLINE) {
        Ok(Message::Devices(list)) => {
            serde_json::from_str(&list).map_err(|error| DevicesError::Refused(error.to_string()))
        }
        Ok(Message::Failed(reason)) => Err(DevicesError::Refused(reason)),
        Ok(_) => Err(DevicesError::Refused("the sensor process lists no devices".to_owned())),
        Err(ReceiveError::Silent) => Err(DevicesError::Silent(driver.name())),
        Err(error) => Err(DevicesError::Refused(error.to_string())),
    }
}

/// The list for people: a device with what it is called, then its modes.
fn page(devices: &[Listed]) -> String {
    if devices.is_empty() {
        return "no sensor is plugged in that OpenNI2 or the kernel knows\n".to_owned();
    }
    let mut text = String::new();
    for Listed { driver, uri, names, serial, vendor, name, usb, profile, modes, trouble } in devices {
        let model = format!("{vendor} {name}");
        let _ = writeln!(text, "{}", model.trim());
        let usb = usb.as_deref().unwrap_or("none");
        let serial = serial.as_deref().unwrap_or("none");
        let _ = writeln!(text, "  driver  {driver}\n  uri     {uri}\n  serial  {serial}\n  usb     {usb}");
        for name in names {
            let _ = writeln!(text, "  name    {name}");
        }
        if let Some(profile) = profile {
            let _ = writeln!(text, "  profile {profile}");
        }
        for mode in modes {
            let _ = writeln!(text, "  mode    {mode}");
        }
        if let Some(trouble) = trouble {
            let _ = writeln!(text, "  trouble {trouble}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::listed::ListedMode;

    #[test]
    fn a_device_is_shown_with_its_names_and_modes_or_its_trouble() {
        let mode =
            ListedMode { width: 640, height: 480, fps: Some(30), format: None, depth_unit_m: Some(0.0001) };
        let device = Listed {
            driver: "openni2".to_owned(),
            uri: "1d27/0601@1/7".to_owned(),
            serial: Some("42".to_owned()),
            vendor: "PrimeSense".to_owned(),
            name: "PS1080".to_owned(),
            usb: Some("1d27:0601".to_owned()),
            modes: vec![mode.clone()],
            ..Listed::default()
        };
        let hung = Listed {
            trouble: Some("it is in use".to_owned()),
            modes: Vec::new(),
            serial: None,
            ..device.clone()
        };
        assert_eq!(
            page(&[device, hung]),
            "PrimeSense PS1080\n  driver  openni2\n  uri     1d27/0601@1/7\n  serial  42\n  usb     1d27:0601\n  \
             mode    640x480 30/s 0.1 mm\nPrimeSense PS1080\n  driver  openni2\n  uri     1d27/0601@1/7\n  serial  none\n  \
             usb     1d27:0601\n  trouble it is in use\n"
        );
        let mode = ListedMode { fps: None, format: Some("Z16".to_owned()), depth_unit_m: None, ..mode };
        let node = Listed {
            driver: "v4l2".to_owned(),
            uri: "/dev/video2".to_owned(),
            names: vec!["/dev/v4l/by-id/usb-a".to_owned(), "1-2".to_owned()],
            name: "Depth".to_owned(),
            profile: Some("realsense-d435".to_owned()),
            modes: vec![mode],
            ..Listed::default()
        };
        assert_eq!(
            page(&[node]),
            "Depth\n  driver  v4l2\n  uri     /dev/video2\n  serial  none\n  usb     none\n  name    /dev/v4l/by-id/usb-a\n  \
             name    1-2\n  profile realsense-d435\n  mode    640x480 Z16\n"
        );
        assert!(page(&[]).contains("no sensor"));
    }
}
