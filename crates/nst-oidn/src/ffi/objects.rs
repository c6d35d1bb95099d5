//! The library's objects: devices, buffers in their memory, and filters.

use std::{
    ffi::{CStr, c_char, c_int},
    ptr::{self, NonNull},
    sync::Arc,
};

use super::functions::{
    BufferObject, DEVICE_TYPE_DEFAULT, DeviceObject, ERROR_NONE, FORMAT_FLOAT3, FilterObject,
    Functions,
};

/// What the library says of a call that failed.
#[derive(Debug)]
pub(crate) struct Failure(pub(crate) String);

/// A device that is ready for filters.
pub(crate) struct Device {
    functions: Arc<Functions>,
    object: NonNull<DeviceObject>,
}

// SAFETY: "All API calls are thread-safe, but operations that use the same device will be
// serialized" (the library's documentation).
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

impl Device {
    /// The device that the library chooses; `OIDN_DEFAULT_DEVICE` changes its mind.
    pub(crate) fn new(functions: &Arc<Functions>) -> Result<Self, Failure> {
        // SAFETY: the function is the library's, and takes any number.
        let object = unsafe { (functions.oidnNewDevice)(DEVICE_TYPE_DEFAULT) };
        let Some(object) = NonNull::new(object) else {
            return Err(failure(functions, ptr::null_mut()).unwrap_or_else(unexplained));
        };
        let device = Self { functions: Arc::clone(functions), object };
        // SAFETY: the device exists.
        unsafe { (functions.oidnCommitDevice)(object.as_ptr()) };
        device.check()?;
        Ok(device)
    }

    /// A number that describes the device or the library.
    pub(crate) fn int(&self, name: &CStr) -> Result<c_int, Failure> {
        // SAFETY: the device exists, and the name ends with 0.
        let value =
            unsafe { (self.functions.oidnGetDeviceInt)(self.object.as_ptr(), name.as_ptr()) };
        self.check()?;
        Ok(value)
    }

    /// The first error of this thread since the last check.
    fn check(&self) -> Result<(), Failure> {
        failure(&self.functions, self.object.as_ptr()).map_or(Ok(()), Err)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the device exists, and nobody uses it any more: buffers and filters would
        // keep it alive.
        unsafe { (self.functions.oidnReleaseDevice)(self.object.as_ptr()) };
    }
}

/// The first error of a device, or of this thread where there is none, since it was asked
/// for; it is cleared.
fn failure(functions: &Functions, device: *mut DeviceObject) -> Option<Failure> {
    let mut message: *const c_char = ptr::null();
    // SAFETY: the device exists or is null, which the function allows.
    let code = unsafe { (functions.oidnGetDeviceError)(device, &raw mut message) };
    if code == ERROR_NONE {
        return None;
    }
    if message.is_null() {
        return Some(Failure(format!("error {code}")));
    }
    // SAFETY: the message ends with 0, and stays until the thread's next call.
    let message = unsafe { CStr::from_ptr(message) }.to_string_lossy();
    Some(Failure(format!("{message} (error {code})")))
}

/// A call that returned nothing, but no error either.
fn unexplained() -> Failure {
    Failure("it does not say why".to_owned())
}

/// Memory that the device can use, wherever that is: the memory of a GPU, or the host's.
pub(crate) struct Buffer {
    device: Arc<Device>,
    object: NonNull<BufferObject>,
    /// How many f32 it has.
    len: usize,
}

// SAFETY: as for `Device`.
unsafe impl Send for Buffer {}

impl Buffer {
    pub(crate) fn new(device: &Arc<Device>, len: usize) -> Result<Self, Failure> {
        let new = device.functions.oidnNewBuffer;
        // SAFETY: the device exists; a size that is too large is an error.
        let object = unsafe { new(device.object.as_ptr(), len.saturating_mul(size_of::<f32>())) };
        // A buffer that comes with an error is released.
        let buffer =
            NonNull::new(object).map(|object| Self { device: Arc::clone(device), object, len });
        device.check()?;
        buffer.ok_or_else(unexplained)
    }

    /// Copies values to the device.
    ///
    /// # Panics
    /// If they are not as many as the buffer's.
    pub(crate) fn write(&self, values: &[f32]) -> Result<(), Failure> {
        assert_eq!(values.len(), self.len, "values for a buffer");
        let write = self.device.functions.oidnWriteBuffer;
        // SAFETY: the buffer exists, and both have this many bytes.
        unsafe { write(self.object.as_ptr(), 0, size_of_val(values), values.as_ptr().cast()) };
        self.device.check()
    }

    /// Copies values from the device.
    ///
    /// # Panics
    /// If they are not as many as the buffer's.
    pub(crate) fn read(&self, values: &mut [f32]) -> Result<(), Failure> {
        assert_eq!(values.len(), self.len, "values of a buffer");
        let read = self.device.functions.oidnReadBuffer;
        // SAFETY: the buffer exists, both have this many bytes, and any bits are an f32.
        unsafe { read(self.object.as_ptr(), 0, size_of_val(values), values.as_mut_ptr().cast()) };
        self.device.check()
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: the buffer exists; filters that use it count as users of their own.
        unsafe { (self.device.functions.oidnReleaseBuffer)(self.object.as_ptr()) };
    }
}

/// A filter for rendered pictures.
pub(crate) struct Filter {
    device: Arc<Device>,
    object: NonNull<FilterObject>,
}

// SAFETY: as for `Device`.
unsafe impl Send for Filter {}

impl Filter {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, Failure> {
        let new = device.functions.oidnNewFilter;
        // SAFETY: the device exists, and the name ends with 0.
        let object = unsafe { new(device.object.as_ptr(), c"RT".as_ptr()) };
        // A filter that comes with an error is released.
        let filter = NonNull::new(object).map(|object| Self { device: Arc::clone(device), object });
        device.check()?;
        filter.ok_or_else(unexplained)
    }

    /// Lets the filter read or write a buffer, of three values per pixel.
    ///
    /// # Panics
    /// If the buffer has another size.
    pub(crate) fn set_image(
        &self,
        name: &CStr,
        buffer: &Buffer,
        (width, height): (usize, usize),
    ) -> Result<(), Failure> {
        assert_eq!(buffer.len, 3 * width * height, "values of a picture's buffer");
        let set = self.device.functions.oidnSetFilterImage;
        let (filter, buffer) = (self.object.as_ptr(), buffer.object.as_ptr());
        // SAFETY: filter and buffer exist, the name ends with 0, the buffer is large enough.
        // It begins with the first pixel, and nothing is between pixels or rows.
        unsafe { set(filter, name.as_ptr(), buffer, FORMAT_FLOAT3, width, height, 0, 0, 0) };
        self.device.check()
    }

    pub(crate) fn set_bool(&self, name: &CStr, value: bool) -> Result<(), Failure> {
        let set = self.device.functions.oidnSetFilterBool;
        // SAFETY: the filter exists, and the name ends with 0.
        unsafe { set(self.object.as_ptr(), name.as_ptr(), value) };
        self.device.check()
    }

    pub(crate) fn set_int(&self, name: &CStr, value: c_int) -> Result<(), Failure> {
        let set = self.device.functions.oidnSetFilterInt;
        // SAFETY: the filter exists, and the name ends with 0.
        unsafe { set(self.object.as_ptr(), name.as_ptr(), value) };
        self.device.check()
    }

    pub(crate) fn set_float(&self, name: &CStr, value: f32) -> Result<(), Failure> {
        let set = self.device.functions.oidnSetFilterFloat;
        // SAFETY: the filter exists, and the name ends with 0.
        unsafe { set(self.object.as_ptr(), name.as_ptr(), value) };
        self.device.check()
    }

    /// A number that describes a filter that was committed.
    pub(crate) fn int(&self, name: &CStr) -> Result<c_int, Failure> {
        let get = self.device.functions.oidnGetFilterInt;
        // SAFETY: the filter exists, and the name ends with 0.
        let value = unsafe { get(self.object.as_ptr(), name.as_ptr()) };
        self.device.check()?;
        Ok(value)
    }

    /// Prepares the filter for what was set.
    pub(crate) fn commit(&self) -> Result<(), Failure> {
        // SAFETY: the filter exists.
        unsafe { (self.device.functions.oidnCommitFilter)(self.object.as_ptr()) };
        self.device.check()
    }

    /// Reads the input's buffers, and writes the output's; returns when it is done.
    pub(crate) fn execute(&self) -> Result<(), Failure> {
        // SAFETY: the filter exists; it was committed, or this is an error.
        unsafe { (self.device.functions.oidnExecuteFilter)(self.object.as_ptr()) };
        self.device.check()
    }
}

impl Drop for Filter {
    fn drop(&mut self) {
        // SAFETY: the filter exists.
        unsafe { (self.device.functions.oidnReleaseFilter)(self.object.as_ptr()) };
    }
}
