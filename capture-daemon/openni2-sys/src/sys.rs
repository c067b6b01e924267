//! OpenNI2's C interface, as bindgen makes it of the headers of OpenNI 2.2. This file is long because the headers
//! are.
//!
//! Made by `examples/regenerate.rs`, and never edited; a test compares the two.

#![allow(unsafe_code, missing_docs, reason = "a C interface, which its headers document")]
#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, reason = "C's names")]
#![allow(clippy::missing_safety_doc, clippy::undocumented_unsafe_blocks, reason = "the headers say what holds")]
#![allow(unused_qualifications, clippy::all, reason = "generated")]

pub const ONI_VERSION_MAJOR: u32 = 2;
pub const ONI_VERSION_MINOR: u32 = 2;
pub const ONI_VERSION_MAINTENANCE: u32 = 0;
pub const ONI_VERSION_BUILD: u32 = 33;
pub const ONI_STATUS_OK: OniStatus = 0;
pub const ONI_STATUS_ERROR: OniStatus = 1;
pub const ONI_STATUS_NOT_IMPLEMENTED: OniStatus = 2;
pub const ONI_STATUS_NOT_SUPPORTED: OniStatus = 3;
pub const ONI_STATUS_BAD_PARAMETER: OniStatus = 4;
pub const ONI_STATUS_OUT_OF_FLOW: OniStatus = 5;
pub const ONI_STATUS_NO_DEVICE: OniStatus = 6;
pub const ONI_STATUS_TIME_OUT: OniStatus = 102;
pub type OniStatus = ::std::os::raw::c_uint;
pub const ONI_SENSOR_IR: OniSensorType = 1;
pub const ONI_SENSOR_COLOR: OniSensorType = 2;
pub const ONI_SENSOR_DEPTH: OniSensorType = 3;
pub type OniSensorType = ::std::os::raw::c_uint;
pub const ONI_PIXEL_FORMAT_DEPTH_1_MM: OniPixelFormat = 100;
pub const ONI_PIXEL_FORMAT_DEPTH_100_UM: OniPixelFormat = 101;
pub const ONI_PIXEL_FORMAT_SHIFT_9_2: OniPixelFormat = 102;
pub const ONI_PIXEL_FORMAT_SHIFT_9_3: OniPixelFormat = 103;
pub const ONI_PIXEL_FORMAT_RGB888: OniPixelFormat = 200;
pub const ONI_PIXEL_FORMAT_YUV422: OniPixelFormat = 201;
pub const ONI_PIXEL_FORMAT_GRAY8: OniPixelFormat = 202;
pub const ONI_PIXEL_FORMAT_GRAY16: OniPixelFormat = 203;
pub const ONI_PIXEL_FORMAT_JPEG: OniPixelFormat = 204;
pub const ONI_PIXEL_FORMAT_YUYV: OniPixelFormat = 205;
pub type OniPixelFormat = ::std::os::raw::c_uint;
pub const ONI_DEVICE_STATE_OK: OniDeviceState = 0;
pub const ONI_DEVICE_STATE_ERROR: OniDeviceState = 1;
pub const ONI_DEVICE_STATE_NOT_READY: OniDeviceState = 2;
pub const ONI_DEVICE_STATE_EOF: OniDeviceState = 3;
pub type OniDeviceState = ::std::os::raw::c_uint;
pub const ONI_IMAGE_REGISTRATION_OFF: OniImageRegistrationMode = 0;
pub const ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR: OniImageRegistrationMode = 1;
pub type OniImageRegistrationMode = ::std::os::raw::c_uint;
pub const ONI_TIMEOUT_NONE: _bindgen_ty_4 = 0;
pub const ONI_TIMEOUT_FOREVER: _bindgen_ty_4 = -1;
pub type _bindgen_ty_4 = ::std::os::raw::c_int;
pub type OniBool = ::std::os::raw::c_int;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniCallbackHandleImpl {
    _unused: [u8; 0],
}
pub type OniCallbackHandle = *mut OniCallbackHandleImpl;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniVersion {
    pub major: ::std::os::raw::c_int,
    pub minor: ::std::os::raw::c_int,
    pub maintenance: ::std::os::raw::c_int,
    pub build: ::std::os::raw::c_int,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniVersion"][::std::mem::size_of::<OniVersion>() - 16usize];
    ["Alignment of OniVersion"][::std::mem::align_of::<OniVersion>() - 4usize];
    [
        "Offset of field: OniVersion::major",
    ][::std::mem::offset_of!(OniVersion, major) - 0usize];
    [
        "Offset of field: OniVersion::minor",
    ][::std::mem::offset_of!(OniVersion, minor) - 4usize];
    [
        "Offset of field: OniVersion::maintenance",
    ][::std::mem::offset_of!(OniVersion, maintenance) - 8usize];
    [
        "Offset of field: OniVersion::build",
    ][::std::mem::offset_of!(OniVersion, build) - 12usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniVideoMode {
    pub pixelFormat: OniPixelFormat,
    pub resolutionX: ::std::os::raw::c_int,
    pub resolutionY: ::std::os::raw::c_int,
    pub fps: ::std::os::raw::c_int,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniVideoMode"][::std::mem::size_of::<OniVideoMode>() - 16usize];
    ["Alignment of OniVideoMode"][::std::mem::align_of::<OniVideoMode>() - 4usize];
    [
        "Offset of field: OniVideoMode::pixelFormat",
    ][::std::mem::offset_of!(OniVideoMode, pixelFormat) - 0usize];
    [
        "Offset of field: OniVideoMode::resolutionX",
    ][::std::mem::offset_of!(OniVideoMode, resolutionX) - 4usize];
    [
        "Offset of field: OniVideoMode::resolutionY",
    ][::std::mem::offset_of!(OniVideoMode, resolutionY) - 8usize];
    [
        "Offset of field: OniVideoMode::fps",
    ][::std::mem::offset_of!(OniVideoMode, fps) - 12usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniSensorInfo {
    pub sensorType: OniSensorType,
    pub numSupportedVideoModes: ::std::os::raw::c_int,
    pub pSupportedVideoModes: *mut OniVideoMode,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniSensorInfo"][::std::mem::size_of::<OniSensorInfo>() - 16usize];
    ["Alignment of OniSensorInfo"][::std::mem::align_of::<OniSensorInfo>() - 8usize];
    [
        "Offset of field: OniSensorInfo::sensorType",
    ][::std::mem::offset_of!(OniSensorInfo, sensorType) - 0usize];
    [
        "Offset of field: OniSensorInfo::numSupportedVideoModes",
    ][::std::mem::offset_of!(OniSensorInfo, numSupportedVideoModes) - 4usize];
    [
        "Offset of field: OniSensorInfo::pSupportedVideoModes",
    ][::std::mem::offset_of!(OniSensorInfo, pSupportedVideoModes) - 8usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniDeviceInfo {
    pub uri: [::std::os::raw::c_char; 256usize],
    pub vendor: [::std::os::raw::c_char; 256usize],
    pub name: [::std::os::raw::c_char; 256usize],
    pub usbVendorId: u16,
    pub usbProductId: u16,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniDeviceInfo"][::std::mem::size_of::<OniDeviceInfo>() - 772usize];
    ["Alignment of OniDeviceInfo"][::std::mem::align_of::<OniDeviceInfo>() - 2usize];
    [
        "Offset of field: OniDeviceInfo::uri",
    ][::std::mem::offset_of!(OniDeviceInfo, uri) - 0usize];
    [
        "Offset of field: OniDeviceInfo::vendor",
    ][::std::mem::offset_of!(OniDeviceInfo, vendor) - 256usize];
    [
        "Offset of field: OniDeviceInfo::name",
    ][::std::mem::offset_of!(OniDeviceInfo, name) - 512usize];
    [
        "Offset of field: OniDeviceInfo::usbVendorId",
    ][::std::mem::offset_of!(OniDeviceInfo, usbVendorId) - 768usize];
    [
        "Offset of field: OniDeviceInfo::usbProductId",
    ][::std::mem::offset_of!(OniDeviceInfo, usbProductId) - 770usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _OniDevice {
    _unused: [u8; 0],
}
pub type OniDeviceHandle = *mut _OniDevice;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _OniStream {
    _unused: [u8; 0],
}
pub type OniStreamHandle = *mut _OniStream;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _OniRecorder {
    _unused: [u8; 0],
}
pub type OniRecorderHandle = *mut _OniRecorder;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniFrame {
    pub dataSize: ::std::os::raw::c_int,
    pub data: *mut ::std::os::raw::c_void,
    pub sensorType: OniSensorType,
    pub timestamp: u64,
    pub frameIndex: ::std::os::raw::c_int,
    pub width: ::std::os::raw::c_int,
    pub height: ::std::os::raw::c_int,
    pub videoMode: OniVideoMode,
    pub croppingEnabled: OniBool,
    pub cropOriginX: ::std::os::raw::c_int,
    pub cropOriginY: ::std::os::raw::c_int,
    pub stride: ::std::os::raw::c_int,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniFrame"][::std::mem::size_of::<OniFrame>() - 80usize];
    ["Alignment of OniFrame"][::std::mem::align_of::<OniFrame>() - 8usize];
    [
        "Offset of field: OniFrame::dataSize",
    ][::std::mem::offset_of!(OniFrame, dataSize) - 0usize];
    ["Offset of field: OniFrame::data"][::std::mem::offset_of!(OniFrame, data) - 8usize];
    [
        "Offset of field: OniFrame::sensorType",
    ][::std::mem::offset_of!(OniFrame, sensorType) - 16usize];
    [
        "Offset of field: OniFrame::timestamp",
    ][::std::mem::offset_of!(OniFrame, timestamp) - 24usize];
    [
        "Offset of field: OniFrame::frameIndex",
    ][::std::mem::offset_of!(OniFrame, frameIndex) - 32usize];
    [
        "Offset of field: OniFrame::width",
    ][::std::mem::offset_of!(OniFrame, width) - 36usize];
    [
        "Offset of field: OniFrame::height",
    ][::std::mem::offset_of!(OniFrame, height) - 40usize];
    [
        "Offset of field: OniFrame::videoMode",
    ][::std::mem::offset_of!(OniFrame, videoMode) - 44usize];
    [
        "Offset of field: OniFrame::croppingEnabled",
    ][::std::mem::offset_of!(OniFrame, croppingEnabled) - 60usize];
    [
        "Offset of field: OniFrame::cropOriginX",
    ][::std::mem::offset_of!(OniFrame, cropOriginX) - 64usize];
    [
        "Offset of field: OniFrame::cropOriginY",
    ][::std::mem::offset_of!(OniFrame, cropOriginY) - 68usize];
    [
        "Offset of field: OniFrame::stride",
    ][::std::mem::offset_of!(OniFrame, stride) - 72usize];
};
pub type OniNewFrameCallback = ::std::option::Option<
    unsafe extern "C" fn(stream: OniStreamHandle, pCookie: *mut ::std::os::raw::c_void),
>;
pub type OniDeviceInfoCallback = ::std::option::Option<
    unsafe extern "C" fn(
        pInfo: *const OniDeviceInfo,
        pCookie: *mut ::std::os::raw::c_void,
    ),
>;
pub type OniDeviceStateCallback = ::std::option::Option<
    unsafe extern "C" fn(
        pInfo: *const OniDeviceInfo,
        deviceState: OniDeviceState,
        pCookie: *mut ::std::os::raw::c_void,
    ),
>;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniDeviceCallbacks {
    pub deviceConnected: OniDeviceInfoCallback,
    pub deviceDisconnected: OniDeviceInfoCallback,
    pub deviceStateChanged: OniDeviceStateCallback,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    [
        "Size of OniDeviceCallbacks",
    ][::std::mem::size_of::<OniDeviceCallbacks>() - 24usize];
    [
        "Alignment of OniDeviceCallbacks",
    ][::std::mem::align_of::<OniDeviceCallbacks>() - 8usize];
    [
        "Offset of field: OniDeviceCallbacks::deviceConnected",
    ][::std::mem::offset_of!(OniDeviceCallbacks, deviceConnected) - 0usize];
    [
        "Offset of field: OniDeviceCallbacks::deviceDisconnected",
    ][::std::mem::offset_of!(OniDeviceCallbacks, deviceDisconnected) - 8usize];
    [
        "Offset of field: OniDeviceCallbacks::deviceStateChanged",
    ][::std::mem::offset_of!(OniDeviceCallbacks, deviceStateChanged) - 16usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniCropping {
    pub enabled: ::std::os::raw::c_int,
    pub originX: ::std::os::raw::c_int,
    pub originY: ::std::os::raw::c_int,
    pub width: ::std::os::raw::c_int,
    pub height: ::std::os::raw::c_int,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniCropping"][::std::mem::size_of::<OniCropping>() - 20usize];
    ["Alignment of OniCropping"][::std::mem::align_of::<OniCropping>() - 4usize];
    [
        "Offset of field: OniCropping::enabled",
    ][::std::mem::offset_of!(OniCropping, enabled) - 0usize];
    [
        "Offset of field: OniCropping::originX",
    ][::std::mem::offset_of!(OniCropping, originX) - 4usize];
    [
        "Offset of field: OniCropping::originY",
    ][::std::mem::offset_of!(OniCropping, originY) - 8usize];
    [
        "Offset of field: OniCropping::width",
    ][::std::mem::offset_of!(OniCropping, width) - 12usize];
    [
        "Offset of field: OniCropping::height",
    ][::std::mem::offset_of!(OniCropping, height) - 16usize];
};
pub type OniDepthPixel = u16;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct OniSeek {
    pub frameIndex: ::std::os::raw::c_int,
    pub stream: OniStreamHandle,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op, reason = "generated")]
const _: () = {
    ["Size of OniSeek"][::std::mem::size_of::<OniSeek>() - 16usize];
    ["Alignment of OniSeek"][::std::mem::align_of::<OniSeek>() - 8usize];
    [
        "Offset of field: OniSeek::frameIndex",
    ][::std::mem::offset_of!(OniSeek, frameIndex) - 0usize];
    [
        "Offset of field: OniSeek::stream",
    ][::std::mem::offset_of!(OniSeek, stream) - 8usize];
};
pub const ONI_DEVICE_PROPERTY_FIRMWARE_VERSION: _bindgen_ty_5 = 0;
pub const ONI_DEVICE_PROPERTY_DRIVER_VERSION: _bindgen_ty_5 = 1;
pub const ONI_DEVICE_PROPERTY_HARDWARE_VERSION: _bindgen_ty_5 = 2;
pub const ONI_DEVICE_PROPERTY_SERIAL_NUMBER: _bindgen_ty_5 = 3;
pub const ONI_DEVICE_PROPERTY_ERROR_STATE: _bindgen_ty_5 = 4;
pub const ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION: _bindgen_ty_5 = 5;
pub const ONI_DEVICE_PROPERTY_PLAYBACK_SPEED: _bindgen_ty_5 = 100;
pub const ONI_DEVICE_PROPERTY_PLAYBACK_REPEAT_ENABLED: _bindgen_ty_5 = 101;
pub type _bindgen_ty_5 = ::std::os::raw::c_uint;
pub const ONI_STREAM_PROPERTY_CROPPING: _bindgen_ty_6 = 0;
pub const ONI_STREAM_PROPERTY_HORIZONTAL_FOV: _bindgen_ty_6 = 1;
pub const ONI_STREAM_PROPERTY_VERTICAL_FOV: _bindgen_ty_6 = 2;
pub const ONI_STREAM_PROPERTY_VIDEO_MODE: _bindgen_ty_6 = 3;
pub const ONI_STREAM_PROPERTY_MAX_VALUE: _bindgen_ty_6 = 4;
pub const ONI_STREAM_PROPERTY_MIN_VALUE: _bindgen_ty_6 = 5;
pub const ONI_STREAM_PROPERTY_STRIDE: _bindgen_ty_6 = 6;
pub const ONI_STREAM_PROPERTY_MIRRORING: _bindgen_ty_6 = 7;
pub const ONI_STREAM_PROPERTY_NUMBER_OF_FRAMES: _bindgen_ty_6 = 8;
pub const ONI_STREAM_PROPERTY_AUTO_WHITE_BALANCE: _bindgen_ty_6 = 100;
pub const ONI_STREAM_PROPERTY_AUTO_EXPOSURE: _bindgen_ty_6 = 101;
pub const ONI_STREAM_PROPERTY_EXPOSURE: _bindgen_ty_6 = 102;
pub const ONI_STREAM_PROPERTY_GAIN: _bindgen_ty_6 = 103;
pub type _bindgen_ty_6 = ::std::os::raw::c_uint;
pub const ONI_DEVICE_COMMAND_SEEK: _bindgen_ty_7 = 1;
pub type _bindgen_ty_7 = ::std::os::raw::c_uint;
pub struct OpenNi2 {
    __library: ::libloading::Library,
    pub oniInitialize: unsafe extern "C" fn(
        apiVersion: ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniShutdown: unsafe extern "C" fn(),
    pub oniGetDeviceList: unsafe extern "C" fn(
        pDevices: *mut *mut OniDeviceInfo,
        pNumDevices: *mut ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniReleaseDeviceList: unsafe extern "C" fn(
        pDevices: *mut OniDeviceInfo,
    ) -> OniStatus,
    pub oniRegisterDeviceCallbacks: unsafe extern "C" fn(
        pCallbacks: *mut OniDeviceCallbacks,
        pCookie: *mut ::std::os::raw::c_void,
        pHandle: *mut OniCallbackHandle,
    ) -> OniStatus,
    pub oniUnregisterDeviceCallbacks: unsafe extern "C" fn(handle: OniCallbackHandle),
    pub oniWaitForAnyStream: unsafe extern "C" fn(
        pStreams: *mut OniStreamHandle,
        numStreams: ::std::os::raw::c_int,
        pStreamIndex: *mut ::std::os::raw::c_int,
        timeout: ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniGetVersion: unsafe extern "C" fn() -> OniVersion,
    pub oniGetExtendedError: unsafe extern "C" fn() -> *const ::std::os::raw::c_char,
    pub oniDeviceOpen: unsafe extern "C" fn(
        uri: *const ::std::os::raw::c_char,
        pDevice: *mut OniDeviceHandle,
    ) -> OniStatus,
    pub oniDeviceClose: unsafe extern "C" fn(device: OniDeviceHandle) -> OniStatus,
    pub oniDeviceGetSensorInfo: unsafe extern "C" fn(
        device: OniDeviceHandle,
        sensorType: OniSensorType,
    ) -> *const OniSensorInfo,
    pub oniDeviceGetInfo: unsafe extern "C" fn(
        device: OniDeviceHandle,
        pInfo: *mut OniDeviceInfo,
    ) -> OniStatus,
    pub oniDeviceCreateStream: unsafe extern "C" fn(
        device: OniDeviceHandle,
        sensorType: OniSensorType,
        pStream: *mut OniStreamHandle,
    ) -> OniStatus,
    pub oniDeviceSetProperty: unsafe extern "C" fn(
        device: OniDeviceHandle,
        propertyId: ::std::os::raw::c_int,
        data: *const ::std::os::raw::c_void,
        dataSize: ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniDeviceGetProperty: unsafe extern "C" fn(
        device: OniDeviceHandle,
        propertyId: ::std::os::raw::c_int,
        data: *mut ::std::os::raw::c_void,
        pDataSize: *mut ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniDeviceIsPropertySupported: unsafe extern "C" fn(
        device: OniDeviceHandle,
        propertyId: ::std::os::raw::c_int,
    ) -> OniBool,
    pub oniDeviceInvoke: unsafe extern "C" fn(
        device: OniDeviceHandle,
        commandId: ::std::os::raw::c_int,
        data: *mut ::std::os::raw::c_void,
        dataSize: ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniDeviceIsCommandSupported: unsafe extern "C" fn(
        device: OniDeviceHandle,
        commandId: ::std::os::raw::c_int,
    ) -> OniBool,
    pub oniStreamDestroy: unsafe extern "C" fn(stream: OniStreamHandle),
    pub oniStreamGetSensorInfo: unsafe extern "C" fn(
        stream: OniStreamHandle,
    ) -> *const OniSensorInfo,
    pub oniStreamStart: unsafe extern "C" fn(stream: OniStreamHandle) -> OniStatus,
    pub oniStreamStop: unsafe extern "C" fn(stream: OniStreamHandle),
    pub oniStreamReadFrame: unsafe extern "C" fn(
        stream: OniStreamHandle,
        pFrame: *mut *mut OniFrame,
    ) -> OniStatus,
    pub oniStreamSetProperty: unsafe extern "C" fn(
        stream: OniStreamHandle,
        propertyId: ::std::os::raw::c_int,
        data: *const ::std::os::raw::c_void,
        dataSize: ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniStreamGetProperty: unsafe extern "C" fn(
        stream: OniStreamHandle,
        propertyId: ::std::os::raw::c_int,
        data: *mut ::std::os::raw::c_void,
        pDataSize: *mut ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniStreamIsPropertySupported: unsafe extern "C" fn(
        stream: OniStreamHandle,
        propertyId: ::std::os::raw::c_int,
    ) -> OniBool,
    pub oniFrameRelease: unsafe extern "C" fn(pFrame: *mut OniFrame),
    pub oniCreateRecorder: unsafe extern "C" fn(
        fileName: *const ::std::os::raw::c_char,
        pRecorder: *mut OniRecorderHandle,
    ) -> OniStatus,
    pub oniRecorderAttachStream: unsafe extern "C" fn(
        recorder: OniRecorderHandle,
        stream: OniStreamHandle,
        allowLossyCompression: OniBool,
    ) -> OniStatus,
    pub oniRecorderStart: unsafe extern "C" fn(recorder: OniRecorderHandle) -> OniStatus,
    pub oniRecorderStop: unsafe extern "C" fn(recorder: OniRecorderHandle),
    pub oniRecorderDestroy: unsafe extern "C" fn(
        pRecorder: *mut OniRecorderHandle,
    ) -> OniStatus,
    pub oniSetLogMinSeverity: unsafe extern "C" fn(
        nMinSeverity: ::std::os::raw::c_int,
    ) -> OniStatus,
    pub oniSetLogConsoleOutput: unsafe extern "C" fn(
        bConsoleOutput: OniBool,
    ) -> OniStatus,
    pub oniSetLogFileOutput: unsafe extern "C" fn(bFileOutput: OniBool) -> OniStatus,
}
impl OpenNi2 {
    pub unsafe fn new<P>(path: P) -> Result<Self, ::libloading::Error>
    where
        P: AsRef<::std::ffi::OsStr>,
    {
        let library = unsafe { ::libloading::Library::new(path) }?;
        unsafe { Self::from_library(library) }
    }
    pub unsafe fn from_library<L>(library: L) -> Result<Self, ::libloading::Error>
    where
        L: Into<::libloading::Library>,
    {
        let __library = library.into();
        let oniInitialize = unsafe { __library.get(b"oniInitialize\0") }
            .map(|sym| *sym)?;
        let oniShutdown = unsafe { __library.get(b"oniShutdown\0") }.map(|sym| *sym)?;
        let oniGetDeviceList = unsafe { __library.get(b"oniGetDeviceList\0") }
            .map(|sym| *sym)?;
        let oniReleaseDeviceList = unsafe { __library.get(b"oniReleaseDeviceList\0") }
            .map(|sym| *sym)?;
        let oniRegisterDeviceCallbacks = unsafe {
            __library.get(b"oniRegisterDeviceCallbacks\0")
        }
            .map(|sym| *sym)?;
        let oniUnregisterDeviceCallbacks = unsafe {
            __library.get(b"oniUnregisterDeviceCallbacks\0")
        }
            .map(|sym| *sym)?;
        let oniWaitForAnyStream = unsafe { __library.get(b"oniWaitForAnyStream\0") }
            .map(|sym| *sym)?;
        let oniGetVersion = unsafe { __library.get(b"oniGetVersion\0") }
            .map(|sym| *sym)?;
        let oniGetExtendedError = unsafe { __library.get(b"oniGetExtendedError\0") }
            .map(|sym| *sym)?;
        let oniDeviceOpen = unsafe { __library.get(b"oniDeviceOpen\0") }
            .map(|sym| *sym)?;
        let oniDeviceClose = unsafe { __library.get(b"oniDeviceClose\0") }
            .map(|sym| *sym)?;
        let oniDeviceGetSensorInfo = unsafe {
            __library.get(b"oniDeviceGetSensorInfo\0")
        }
            .map(|sym| *sym)?;
        let oniDeviceGetInfo = unsafe { __library.get(b"oniDeviceGetInfo\0") }
            .map(|sym| *sym)?;
        let oniDeviceCreateStream = unsafe { __library.get(b"oniDeviceCreateStream\0") }
            .map(|sym| *sym)?;
        let oniDeviceSetProperty = unsafe { __library.get(b"oniDeviceSetProperty\0") }
            .map(|sym| *sym)?;
        let oniDeviceGetProperty = unsafe { __library.get(b"oniDeviceGetProperty\0") }
            .map(|sym| *sym)?;
        let oniDeviceIsPropertySupported = unsafe {
            __library.get(b"oniDeviceIsPropertySupported\0")
        }
            .map(|sym| *sym)?;
        let oniDeviceInvoke = unsafe { __library.get(b"oniDeviceInvoke\0") }
            .map(|sym| *sym)?;
        let oniDeviceIsCommandSupported = unsafe {
            __library.get(b"oniDeviceIsCommandSupported\0")
        }
            .map(|sym| *sym)?;
        let oniStreamDestroy = unsafe { __library.get(b"oniStreamDestroy\0") }
            .map(|sym| *sym)?;
        let oniStreamGetSensorInfo = unsafe {
            __library.get(b"oniStreamGetSensorInfo\0")
        }
            .map(|sym| *sym)?;
        let oniStreamStart = unsafe { __library.get(b"oniStreamStart\0") }
            .map(|sym| *sym)?;
        let oniStreamStop = unsafe { __library.get(b"oniStreamStop\0") }
            .map(|sym| *sym)?;
        let oniStreamReadFrame = unsafe { __library.get(b"oniStreamReadFrame\0") }
            .map(|sym| *sym)?;
        let oniStreamSetProperty = unsafe { __library.get(b"oniStreamSetProperty\0") }
            .map(|sym| *sym)?;
        let oniStreamGetProperty = unsafe { __library.get(b"oniStreamGetProperty\0") }
            .map(|sym| *sym)?;
        let oniStreamIsPropertySupported = unsafe {
            __library.get(b"oniStreamIsPropertySupported\0")
        }
            .map(|sym| *sym)?;
        let oniFrameRelease = unsafe { __library.get(b"oniFrameRelease\0") }
            .map(|sym| *sym)?;
        let oniCreateRecorder = unsafe { __library.get(b"oniCreateRecorder\0") }
            .map(|sym| *sym)?;
        let oniRecorderAttachStream = unsafe {
            __library.get(b"oniRecorderAttachStream\0")
        }
            .map(|sym| *sym)?;
        let oniRecorderStart = unsafe { __library.get(b"oniRecorderStart\0") }
            .map(|sym| *sym)?;
        let oniRecorderStop = unsafe { __library.get(b"oniRecorderStop\0") }
            .map(|sym| *sym)?;
        let oniRecorderDestroy = unsafe { __library.get(b"oniRecorderDestroy\0") }
            .map(|sym| *sym)?;
        let oniSetLogMinSeverity = unsafe { __library.get(b"oniSetLogMinSeverity\0") }
            .map(|sym| *sym)?;
        let oniSetLogConsoleOutput = unsafe {
            __library.get(b"oniSetLogConsoleOutput\0")
        }
            .map(|sym| *sym)?;
        let oniSetLogFileOutput = unsafe { __library.get(b"oniSetLogFileOutput\0") }
            .map(|sym| *sym)?;
        Ok(OpenNi2 {
            __library,
            oniInitialize,
            oniShutdown,
            oniGetDeviceList,
            oniReleaseDeviceList,
            oniRegisterDeviceCallbacks,
            oniUnregisterDeviceCallbacks,
            oniWaitForAnyStream,
            oniGetVersion,
            oniGetExtendedError,
            oniDeviceOpen,
            oniDeviceClose,
            oniDeviceGetSensorInfo,
            oniDeviceGetInfo,
            oniDeviceCreateStream,
            oniDeviceSetProperty,
            oniDeviceGetProperty,
            oniDeviceIsPropertySupported,
            oniDeviceInvoke,
            oniDeviceIsCommandSupported,
            oniStreamDestroy,
            oniStreamGetSensorInfo,
            oniStreamStart,
            oniStreamStop,
            oniStreamReadFrame,
            oniStreamSetProperty,
            oniStreamGetProperty,
            oniStreamIsPropertySupported,
            oniFrameRelease,
            oniCreateRecorder,
            oniRecorderAttachStream,
            oniRecorderStart,
            oniRecorderStop,
            oniRecorderDestroy,
            oniSetLogMinSeverity,
            oniSetLogConsoleOutput,
            oniSetLogFileOutput,
        })
    }
    pub unsafe fn oniInitialize(&self, apiVersion: ::std::os::raw::c_int) -> OniStatus {
        unsafe { (self.oniInitialize)(apiVersion) }
    }
    pub unsafe fn oniShutdown(&self) {
        unsafe { (self.oniShutdown)() }
    }
    pub unsafe fn oniGetDeviceList(
        &self,
        pDevices: *mut *mut OniDeviceInfo,
        pNumDevices: *mut ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniGetDeviceList)(pDevices, pNumDevices) }
    }
    pub unsafe fn oniReleaseDeviceList(
        &self,
        pDevices: *mut OniDeviceInfo,
    ) -> OniStatus {
        unsafe { (self.oniReleaseDeviceList)(pDevices) }
    }
    pub unsafe fn oniRegisterDeviceCallbacks(
        &self,
        pCallbacks: *mut OniDeviceCallbacks,
        pCookie: *mut ::std::os::raw::c_void,
        pHandle: *mut OniCallbackHandle,
    ) -> OniStatus {
        unsafe { (self.oniRegisterDeviceCallbacks)(pCallbacks, pCookie, pHandle) }
    }
    pub unsafe fn oniUnregisterDeviceCallbacks(&self, handle: OniCallbackHandle) {
        unsafe { (self.oniUnregisterDeviceCallbacks)(handle) }
    }
    pub unsafe fn oniWaitForAnyStream(
        &self,
        pStreams: *mut OniStreamHandle,
        numStreams: ::std::os::raw::c_int,
        pStreamIndex: *mut ::std::os::raw::c_int,
        timeout: ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe {
            (self.oniWaitForAnyStream)(pStreams, numStreams, pStreamIndex, timeout)
        }
    }
    pub unsafe fn oniGetVersion(&self) -> OniVersion {
        unsafe { (self.oniGetVersion)() }
    }
    pub unsafe fn oniGetExtendedError(&self) -> *const ::std::os::raw::c_char {
        unsafe { (self.oniGetExtendedError)() }
    }
    pub unsafe fn oniDeviceOpen(
        &self,
        uri: *const ::std::os::raw::c_char,
        pDevice: *mut OniDeviceHandle,
    ) -> OniStatus {
        unsafe { (self.oniDeviceOpen)(uri, pDevice) }
    }
    pub unsafe fn oniDeviceClose(&self, device: OniDeviceHandle) -> OniStatus {
        unsafe { (self.oniDeviceClose)(device) }
    }
    pub unsafe fn oniDeviceGetSensorInfo(
        &self,
        device: OniDeviceHandle,
        sensorType: OniSensorType,
    ) -> *const OniSensorInfo {
        unsafe { (self.oniDeviceGetSensorInfo)(device, sensorType) }
    }
    pub unsafe fn oniDeviceGetInfo(
        &self,
        device: OniDeviceHandle,
        pInfo: *mut OniDeviceInfo,
    ) -> OniStatus {
        unsafe { (self.oniDeviceGetInfo)(device, pInfo) }
    }
    pub unsafe fn oniDeviceCreateStream(
        &self,
        device: OniDeviceHandle,
        sensorType: OniSensorType,
        pStream: *mut OniStreamHandle,
    ) -> OniStatus {
        unsafe { (self.oniDeviceCreateStream)(device, sensorType, pStream) }
    }
    pub unsafe fn oniDeviceSetProperty(
        &self,
        device: OniDeviceHandle,
        propertyId: ::std::os::raw::c_int,
        data: *const ::std::os::raw::c_void,
        dataSize: ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniDeviceSetProperty)(device, propertyId, data, dataSize) }
    }
    pub unsafe fn oniDeviceGetProperty(
        &self,
        device: OniDeviceHandle,
        propertyId: ::std::os::raw::c_int,
        data: *mut ::std::os::raw::c_void,
        pDataSize: *mut ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniDeviceGetProperty)(device, propertyId, data, pDataSize) }
    }
    pub unsafe fn oniDeviceIsPropertySupported(
        &self,
        device: OniDeviceHandle,
        propertyId: ::std::os::raw::c_int,
    ) -> OniBool {
        unsafe { (self.oniDeviceIsPropertySupported)(device, propertyId) }
    }
    pub unsafe fn oniDeviceInvoke(
        &self,
        device: OniDeviceHandle,
        commandId: ::std::os::raw::c_int,
        data: *mut ::std::os::raw::c_void,
        dataSize: ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniDeviceInvoke)(device, commandId, data, dataSize) }
    }
    pub unsafe fn oniDeviceIsCommandSupported(
        &self,
        device: OniDeviceHandle,
        commandId: ::std::os::raw::c_int,
    ) -> OniBool {
        unsafe { (self.oniDeviceIsCommandSupported)(device, commandId) }
    }
    pub unsafe fn oniStreamDestroy(&self, stream: OniStreamHandle) {
        unsafe { (self.oniStreamDestroy)(stream) }
    }
    pub unsafe fn oniStreamGetSensorInfo(
        &self,
        stream: OniStreamHandle,
    ) -> *const OniSensorInfo {
        unsafe { (self.oniStreamGetSensorInfo)(stream) }
    }
    pub unsafe fn oniStreamStart(&self, stream: OniStreamHandle) -> OniStatus {
        unsafe { (self.oniStreamStart)(stream) }
    }
    pub unsafe fn oniStreamStop(&self, stream: OniStreamHandle) {
        unsafe { (self.oniStreamStop)(stream) }
    }
    pub unsafe fn oniStreamReadFrame(
        &self,
        stream: OniStreamHandle,
        pFrame: *mut *mut OniFrame,
    ) -> OniStatus {
        unsafe { (self.oniStreamReadFrame)(stream, pFrame) }
    }
    pub unsafe fn oniStreamSetProperty(
        &self,
        stream: OniStreamHandle,
        propertyId: ::std::os::raw::c_int,
        data: *const ::std::os::raw::c_void,
        dataSize: ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniStreamSetProperty)(stream, propertyId, data, dataSize) }
    }
    pub unsafe fn oniStreamGetProperty(
        &self,
        stream: OniStreamHandle,
        propertyId: ::std::os::raw::c_int,
        data: *mut ::std::os::raw::c_void,
        pDataSize: *mut ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniStreamGetProperty)(stream, propertyId, data, pDataSize) }
    }
    pub unsafe fn oniStreamIsPropertySupported(
        &self,
        stream: OniStreamHandle,
        propertyId: ::std::os::raw::c_int,
    ) -> OniBool {
        unsafe { (self.oniStreamIsPropertySupported)(stream, propertyId) }
    }
    pub unsafe fn oniFrameRelease(&self, pFrame: *mut OniFrame) {
        unsafe { (self.oniFrameRelease)(pFrame) }
    }
    pub unsafe fn oniCreateRecorder(
        &self,
        fileName: *const ::std::os::raw::c_char,
        pRecorder: *mut OniRecorderHandle,
    ) -> OniStatus {
        unsafe { (self.oniCreateRecorder)(fileName, pRecorder) }
    }
    pub unsafe fn oniRecorderAttachStream(
        &self,
        recorder: OniRecorderHandle,
        stream: OniStreamHandle,
        allowLossyCompression: OniBool,
    ) -> OniStatus {
        unsafe {
            (self.oniRecorderAttachStream)(recorder, stream, allowLossyCompression)
        }
    }
    pub unsafe fn oniRecorderStart(&self, recorder: OniRecorderHandle) -> OniStatus {
        unsafe { (self.oniRecorderStart)(recorder) }
    }
    pub unsafe fn oniRecorderStop(&self, recorder: OniRecorderHandle) {
        unsafe { (self.oniRecorderStop)(recorder) }
    }
    pub unsafe fn oniRecorderDestroy(
        &self,
        pRecorder: *mut OniRecorderHandle,
    ) -> OniStatus {
        unsafe { (self.oniRecorderDestroy)(pRecorder) }
    }
    pub unsafe fn oniSetLogMinSeverity(
        &self,
        nMinSeverity: ::std::os::raw::c_int,
    ) -> OniStatus {
        unsafe { (self.oniSetLogMinSeverity)(nMinSeverity) }
    }
    pub unsafe fn oniSetLogConsoleOutput(&self, bConsoleOutput: OniBool) -> OniStatus {
        unsafe { (self.oniSetLogConsoleOutput)(bConsoleOutput) }
    }
    pub unsafe fn oniSetLogFileOutput(&self, bFileOutput: OniBool) -> OniStatus {
        unsafe { (self.oniSetLogFileOutput)(bFileOutput) }
    }
}
