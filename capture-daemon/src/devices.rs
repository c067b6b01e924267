//! The verb `devices`: the sensors that are plugged in. They are listed by a process of its own, as they are streamed
//! by one: a driver that hangs is left to itself.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use common::sentence::print;

use crate::cli::DevicesArgs;
use crate::config;
use crate::source::host::{self, Message, Order, ReceiveError, Task};
use crate::source::openni2::Listed;

/// How long the drivers may take.
const DEADLINE: Duration = Duration::from_secs(20);

/// Why the sensors cannot be listed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DevicesError {
    /// The library refuses, or is not there.
    #[error("{0}")]
    Refused(String),
    /// Its drivers take too long.
    #[error(
        "the drivers of OpenNI2 do not list their devices within {} s; unplug the sensor and plug it in again",
        DEADLINE.as_secs()
    )]
    Silent,
}

/// Prints the sensors.
///
/// # Errors
/// When the configuration is not valid, they cannot be listed, or stdout cannot be written.
pub fn devices(args: &DevicesArgs) -> anyhow::Result<()> {
    let config = config::load(args.config.config.as_deref(), &args.config.sets)?;
    let order = Order { task: Task::List, camera: None, sensor: config.sensor };
    let text = list(&order)?;
    if args.json {
        return Ok(print(&format!("{text}\n"))?);
    }
    let devices: Vec<Listed> = serde_json::from_str(&text)?;
    Ok(print(&page(&devices))?)
}

/// The list, as JSON.
fn list(order: &Order) -> Result<String, DevicesError> {
    let mut process = host::start(None, order).map_err(|error| DevicesError::Refused(error.to_string()))?;
    let due = Instant::now() + DEADLINE;
    match process.receive(due.saturating_duration_since(Instant::now())) {
        Ok(Message::Devices(list)) => Ok(list),
        Ok(Message::Failed(reason)) => Err(DevicesError::Refused(reason)),
        Ok(_) => Err(DevicesError::Refused("the sensor process lists no devices".to_owned())),
        Err(ReceiveError::Silent) => Err(DevicesError::Silent),
        Err(error) => Err(DevicesError::Refused(error.to_string())),
    }
}

/// The list for people: a device with what it is called, then its modes.
fn page(devices: &[Listed]) -> String {
    if devices.is_empty() {
        return "no sensor is plugged in that OpenNI2 knows\n".to_owned();
    }
    let mut text = String::new();
    for Listed { driver, uri, serial, vendor, name, usb, modes, trouble } in devices {
        let model = format!("{vendor} {name}");
        let _ = writeln!(text, "{}", model.trim());
        let usb = usb.as_deref().unwrap_or("none");
        let serial = serial.as_deref().unwrap_or("none");
        let _ = writeln!(text, "  driver  {driver}\n  uri     {uri}\n  serial  {serial}\n  usb     {usb}");
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
    use crate::source::openni2::Mode;

    #[test]
    fn a_device_is_shown_with_its_modes_or_its_trouble() {
        let mode = Mode { width: 640, height: 480, fps: 30, depth_unit_m: 0.0001 };
        let device = Listed {
            driver: "openni2".to_owned(),
            uri: "1d27/0601@1/7".to_owned(),
            serial: Some("42".to_owned()),
            vendor: "PrimeSense".to_owned(),
            name: "PS1080".to_owned(),
            usb: Some("1d27:0601".to_owned()),
            modes: vec![mode],
            trouble: None,
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
        assert!(page(&[]).contains("no sensor"));
    }
}
