//! A message from a client, taken apart: which method, with what parameters, or what it is told instead.

use common::protocol::StationError;
use serde_json::{Map, Value, json};

use crate::keeper::{BladeText, Order};

/// A call that is well formed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Call {
    /// `org.varlink.service.GetInfo`
    GetInfo,
    /// `org.varlink.service.GetInterfaceDescription`
    GetInterfaceDescription { interface: String },
    /// The newest library, as soon as it is newer than `after`.
    GetLibrary { after: i64 },
    /// The newest preview, as soon as its sequence number is another than `after`.
    GetPreview { after: i64 },
    /// What the station is doing.
    GetStatus,
    /// What the library holds.
    ListBlades,
    /// What a name can go back to.
    ListHistory { name: String },
    /// What names that no blade has now would go back to.
    ListRemoved,
    /// A change of the store.
    Order(Order),
    /// Something about recordings.
    Recording(RecordingCall),
    /// Capture now.
    Capture,
    /// Read the configuration again.
    Reload,
}

/// A call that is about recordings.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum RecordingCall {
    /// Begin one.
    Start,
    /// End it.
    Stop,
    /// Save the last seconds.
    Save,
    /// What there is.
    List,
    /// Have one stay, or no longer.
    Pin { name: String, pinned: bool },
    /// Remove one.
    Remove { name: String },
}

/// What one must be allowed for a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Right {
    /// Nothing.
    Anyone,
    /// To watch.
    Watch,
    /// To change.
    Change,
}

/// Why a call is not answered with what it asked for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CallError {
    /// `org.varlink.service.InterfaceNotFound`
    InterfaceNotFound { interface: String },
    /// `org.varlink.service.MethodNotFound`
    MethodNotFound { method: String },
    /// `org.varlink.service.MethodNotImplemented`: no method goes over to another protocol.
    MethodNotImplemented { method: String },
    /// `org.varlink.service.InvalidParameter`: missing, of the wrong type, or none of the method's.
    InvalidParameter { parameter: String },
    /// `org.varlink.service.PermissionDenied`
    PermissionDenied,
    /// An error of `io.sward.Station`.
    Station(StationError),
}

impl From<StationError> for CallError {
    fn from(error: StationError) -> Self {
        Self::Station(error)
    }
}

impl CallError {
    /// The reply that tells it.
    pub(crate) fn reply(&self) -> Value {
        let standard = |name: &str, parameters: Value| json!({"error": format!("org.varlink.service.{name}"), "parameters": parameters});
        match self {
            Self::InterfaceNotFound { interface } => {
                standard("InterfaceNotFound", json!({"interface": interface}))
            }
            Self::MethodNotFound { method } => standard("MethodNotFound", json!({"method": method})),
            Self::MethodNotImplemented { method } => {
                standard("MethodNotImplemented", json!({"method": method}))
            }
            Self::InvalidParameter { parameter } => {
                standard("InvalidParameter", json!({"parameter": parameter}))
            }
            // Without parameters: zlink takes an error that has none and brings `{}` for an unknown one.
            Self::PermissionDenied => json!({"error": "org.varlink.service.PermissionDenied"}),
            Self::Station(error) => serde_json::to_value(error).unwrap_or(Value::Null),
        }
    }
}

/// A message of a client.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Message {
    /// What it asks for.
    pub(crate) call: Result<Call, CallError>,
    /// It wants no reply.
    pub(crate) oneway: bool,
}

/// Largest part of what a client sent that it is told again.
const MAX_ECHO_CHARS: usize = 200;

impl Message {
    /// Reads the bytes of one message, without the zero byte at its end; `None` when they are no JSON
    /// object, so that whoever sent them speaks something else.
    pub(crate) fn parse(bytes: &[u8]) -> Option<Self> {
        let Ok(Value::Object(mut message)) = serde_json::from_slice(bytes) else { return None };
        let mut flag = |name: &str| match message.remove(name) {
            None | Some(Value::Null) => Ok(false),
            Some(Value::Bool(flag)) => Ok(flag),
            Some(_) => Err(invalid(name)),
        };
        let flags = [flag("oneway"), flag("more"), flag("upgrade")];
        let oneway = flags[0] == Ok(true);
        let method = match message.remove("method") {
            Some(Value::String(method)) => method,
            _ => return Some(Self { call: Err(invalid("method")), oneway }),
        };
        let parameters = match message.remove("parameters") {
            None | Some(Value::Null) => Ok(Map::new()),
            Some(Value::Object(parameters)) => Ok(parameters),
            Some(_) => Err(invalid("parameters")),
        };
        let [one, more, upgrade] = flags;
        let call = one.and(more).and(upgrade).and_then(|upgrade| {
            let call = Call::parse(&method, Parameters(parameters?))?;
            if upgrade { Err(CallError::MethodNotImplemented { method: echo(&method) }) } else { Ok(call) }
        });
        Some(Self { call, oneway })
    }
}

impl Call {
    fn parse(method: &str, mut parameters: Parameters) -> Result<Self, CallError> {
        let interface = method.rsplit_once('.').map_or(method, |(interface, _)| interface);
        if !["io.sward.Station", "org.varlink.service"].contains(&interface) {
            return Err(CallError::InterfaceNotFound { interface: echo(interface) });
        }
        let call = match method {
            "org.varlink.service.GetInfo" => Self::GetInfo,
            "org.varlink.service.GetInterfaceDescription" => {
                Self::GetInterfaceDescription { interface: parameters.text("interface")? }
            }
            "io.sward.Station.GetLibrary" => Self::GetLibrary { after: parameters.whole("after")? },
            "io.sward.Station.GetPreview" => Self::GetPreview { after: parameters.whole("after")? },
            "io.sward.Station.GetStatus" => Self::GetStatus,
            "io.sward.Station.ListBlades" => Self::ListBlades,
            "io.sward.Station.ListHistory" => Self::ListHistory { name: parameters.text("name")? },
            "io.sward.Station.ListRemoved" => Self::ListRemoved,
            "io.sward.Station.Capture" => Self::Capture,
            "io.sward.Station.StartRecording" => Self::Recording(RecordingCall::Start),
            "io.sward.Station.StopRecording" => Self::Recording(RecordingCall::Stop),
            "io.sward.Station.SaveRecording" => Self::Recording(RecordingCall::Save),
            "io.sward.Station.ListRecordings" => Self::Recording(RecordingCall::List),
            "io.sward.Station.PinRecording" => Self::Recording(RecordingCall::Pin {
                name: parameters.text("name")?,
                pinned: parameters.flag("pinned")?,
            }),
            "io.sward.Station.RemoveRecording" => {
                Self::Recording(RecordingCall::Remove { name: parameters.text("name")? })
            }
            "io.sward.Station.Reload" => Self::Reload,
            "io.sward.Station.SetMix" => {
                Self::Order(Order::SetMix { name: parameters.text("name")?, mix: parameters.number("mix")? })
            }
            "io.sward.Station.RenameBlade" => Self::Order(Order::Rename {
                name: parameters.text("name")?,
                new_name: parameters.text("new_name")?,
            }),
            "io.sward.Station.PutBlade" => Self::Order(Order::Put {
                name: parameters.text("name")?,
                text: BladeText(parameters.text("text")?),
            }),
            "io.sward.Station.RemoveBlade" => Self::Order(Order::Remove { name: parameters.text("name")? }),
            "io.sward.Station.RestoreBlade" => Self::Order(Order::Restore {
                name: parameters.text("name")?,
                back: parameters.count("back", 1)?,
            }),
            _ => return Err(CallError::MethodNotFound { method: echo(method) }),
        };
        parameters.end()?;
        Ok(call)
    }

    /// What one must be allowed for it.
    pub(crate) fn right(&self) -> Right {
        match self {
            Self::GetInfo | Self::GetInterfaceDescription { .. } => Right::Anyone,
            Self::GetLibrary { .. }
            | Self::GetPreview { .. }
            | Self::GetStatus
            | Self::ListBlades
            | Self::ListHistory { .. }
            | Self::Recording(RecordingCall::List)
            | Self::ListRemoved => Right::Watch,
            Self::Recording(_) | Self::Order(_) | Self::Capture | Self::Reload => Right::Change,
        }
    }
}

struct Parameters(Map<String, Value>);

impl Parameters {
    fn text(&mut self, name: &str) -> Result<String, CallError> {
        match self.0.remove(name) {
            Some(Value::String(text)) => Ok(text),
            _ => Err(invalid(name)),
        }
    }

    fn flag(&mut self, name: &str) -> Result<bool, CallError> {
        self.0.remove(name).and_then(|value| value.as_bool()).ok_or_else(|| invalid(name))
    }

    fn whole(&mut self, name: &str) -> Result<i64, CallError> {
        self.0.remove(name).and_then(|value| value.as_i64()).ok_or_else(|| invalid(name))
    }

    /// A whole number from 1 on; `otherwise` where there is none.
    fn count(&mut self, name: &str, otherwise: usize) -> Result<usize, CallError> {
        match self.0.remove(name) {
            None | Some(Value::Null) => Ok(otherwise),
            Some(value) => {
                let count = value.as_u64().and_then(|count| usize::try_from(count).ok());
                count.filter(|count| *count > 0).ok_or_else(|| invalid(name))
            }
        }
    }

    fn number(&mut self, name: &str) -> Result<f64, CallError> {
        self.0.remove(name).and_then(|value| value.as_f64()).ok_or_else(|| invalid(name))
    }

    fn end(&self) -> Result<(), CallError> {
        self.0.keys().next().map_or(Ok(()), |name| Err(invalid(name)))
    }
}

fn invalid(parameter: &str) -> CallError {
    CallError::InvalidParameter { parameter: echo(parameter) }
}

fn echo(text: &str) -> String {
    text.chars().take(MAX_ECHO_CHARS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn call(text: &str) -> Result<Call, CallError> {
        Message::parse(text.as_bytes()).expect("a JSON object").call
    }

    #[test]
    fn each_method_is_read() {
        let station = |method: &str, parameters: &str| {
            call(&format!(r#"{{"method":"io.sward.Station.{method}","parameters":{parameters}}}"#))
        };
        let name = || "fern".to_owned();
        let new_name = || "moss".to_owned();
        for (method, parameters, expected) in [
            ("GetLibrary", r#"{"after":7}"#, Call::GetLibrary { after: 7 }),
            ("GetPreview", r#"{"after":0}"#, Call::GetPreview { after: 0 }),
            ("GetStatus", "{}", Call::GetStatus),
            ("GetStatus", "null", Call::GetStatus),
            ("ListBlades", "{}", Call::ListBlades),
            ("ListRemoved", "{}", Call::ListRemoved),
            ("Capture", "{}", Call::Capture),
            ("Reload", "{}", Call::Reload),
            ("StartRecording", "{}", Call::Recording(RecordingCall::Start)),
            ("StopRecording", "{}", Call::Recording(RecordingCall::Stop)),
            ("SaveRecording", "{}", Call::Recording(RecordingCall::Save)),
            ("ListRecordings", "{}", Call::Recording(RecordingCall::List)),
            (
                "PinRecording",
                r#"{"name":"fern","pinned":true}"#,
                Call::Recording(RecordingCall::Pin { name: name(), pinned: true }),
            ),
            (
                "RemoveRecording",
                r#"{"name":"fern"}"#,
                Call::Recording(RecordingCall::Remove { name: name() }),
            ),
            ("SetMix", r#"{"name":"fern","mix":2}"#, Call::Order(Order::SetMix { name: name(), mix: 2.0 })),
            (
                "RenameBlade",
                r#"{"name":"fern","new_name":"moss"}"#,
                Call::Order(Order::Rename { name: name(), new_name: new_name() }),
            ),
            (
                "PutBlade",
                r#"{"name":"fern","text":"format = 1"}"#,
                Call::Order(Order::Put { name: name(), text: BladeText("format = 1".to_owned()) }),
            ),
            ("RemoveBlade", r#"{"name":"fern"}"#, Call::Order(Order::Remove { name: name() })),
            ("RestoreBlade", r#"{"name":"fern"}"#, Call::Order(Order::Restore { name: name(), back: 1 })),
            (
                "RestoreBlade",
                r#"{"name":"fern","back":3}"#,
                Call::Order(Order::Restore { name: name(), back: 3 }),
            ),
            ("ListHistory", r#"{"name":"fern"}"#, Call::ListHistory { name: name() }),
        ] {
            assert_eq!(station(method, parameters), Ok(expected));
        }
        assert_eq!(call(r#"{"method":"org.varlink.service.GetInfo"}"#), Ok(Call::GetInfo));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let parameter = |text: &str| match call(text) {
            Err(CallError::InvalidParameter { parameter }) => parameter,
            other => panic!("{text}: {other:?}"),
        };
        let library = r#"{"method":"io.sward.Station.GetLibrary","parameters":"#;
        for (text, expected) in [
            ("{}".to_owned(), "method"),
            (r#"{"method":7}"#.to_owned(), "method"),
            (format!(r#"{library}{{}}}}"#), "after"),
            (format!(r#"{library}{{"after":"x"}}}}"#), "after"),
            (format!(r#"{library}{{"after":1.5}}}}"#), "after"),
            (format!(r#"{library}{{"after":99999999999999999999}}}}"#), "after"),
            (format!(r#"{library}{{"after":1,"before":2}}}}"#), "before"),
            (format!(r#"{library}[]}}"#), "parameters"),
            (format!(r#"{library}{{"after":1}},"oneway":"yes"}}"#), "oneway"),
        ] {
            assert_eq!(parameter(&text), expected);
        }
        let upgrade = r#"{"method":"io.sward.Station.GetStatus","upgrade":true}"#;
        assert!(matches!(call(upgrade), Err(CallError::MethodNotImplemented { .. })));
        assert!(matches!(
            call(r#"{"method":"io.sward.Station.Mow"}"#),
            Err(CallError::MethodNotFound { .. })
        ));
        assert!(matches!(call(r#"{"method":"io.other.Mow"}"#), Err(CallError::InterfaceNotFound { .. })));
        assert!(matches!(call(r#"{"method":""}"#), Err(CallError::InterfaceNotFound { .. })));
        for noise in ["", "[]", "7", "green", "{", "\u{16}\u{3}"] {
            assert_eq!(Message::parse(noise.as_bytes()), None);
        }
        assert_eq!(Message::parse(&[b'['; 10_000]), None, "no deep recursion");
    }

    #[test]
    fn only_watching_is_less_than_changing() {
        assert_eq!(Call::GetInfo.right(), Right::Anyone);
        assert_eq!(Call::ListBlades.right(), Right::Watch);
        assert_eq!(Call::GetPreview { after: 0 }.right(), Right::Watch);
        assert_eq!(Call::Reload.right(), Right::Change);
        assert_eq!(Call::Recording(RecordingCall::List).right(), Right::Watch);
        assert_eq!(Call::Recording(RecordingCall::Start).right(), Right::Change);
    }
}
