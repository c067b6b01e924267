//! Sensors as `sward-capture devices` lists them, whatever driver reads them.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A sensor that is plugged in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Listed {
    /// The driver that reads it: a value of `sensor.driver`.
    pub driver: String,
    /// What it is opened by: OpenNI2's URI with bus and port, or V4L2's node.
    pub uri: String,
    /// Other names that `sensor.device` may say: V4L2's links by id and by path, the USB port.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
    /// Its serial number, if it tells one.
    pub serial: Option<String>,
    /// Its vendor.
    pub vendor: String,
    /// Its model.
    pub name: String,
    /// USB vendor and product, hexadecimal; none where it is no USB device.
    pub usb: Option<String>,
    /// What is known of sensors of this kind: a value of `sensor.profile`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Modes of its depth.
    pub modes: Vec<ListedMode>,
    /// Why it cannot be opened.
    pub trouble: Option<String>,
}

/// A mode of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ListedMode {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Frames each second, where the driver says.
    pub fps: Option<u32>,
    /// V4L2's pixel format: a value of `sensor.format`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Metres of one count, where it is known.
    pub depth_unit_m: Option<f64>,
}

impl fmt::Display for ListedMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)?;
        if let Some(fps) = self.fps {
            write!(f, " {fps}/s")?;
        }
        if let Some(format) = &self.format {
            write!(f, " {format}")?;
        }
        self.depth_unit_m.map_or(Ok(()), |unit_m| write!(f, " {} mm", unit_m * 1e3))
    }
}
