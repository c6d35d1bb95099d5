//! The library's functions, by their names.

use std::{
    ffi::{c_char, c_int, c_void},
    mem::ManuallyDrop,
    path::Path,
};

use libloading::Library;

/// Objects of the library; only pointers to them exist.
#[repr(C)]
pub(super) struct DeviceObject([u8; 0]);
#[repr(C)]
pub(super) struct FilterObject([u8; 0]);
#[repr(C)]
pub(super) struct BufferObject([u8; 0]);

/// `OIDN_DEVICE_TYPE_DEFAULT`: the library chooses.
pub(super) const DEVICE_TYPE_DEFAULT: c_int = 0;
/// `OIDN_FORMAT_FLOAT3`: three f32 per pixel.
pub(super) const FORMAT_FLOAT3: c_int = 3;
/// `OIDN_ERROR_NONE`.
pub(super) const ERROR_NONE: c_int = 0;

/// Why a library cannot be used.
pub(crate) enum LoadError {
    /// The system's loader refuses it, with these words.
    Loader(String),
    /// It is of version 1.
    VersionOne,
    /// It lacks this function.
    Function(&'static str),
}

/// Declares [`Functions`]: each field has the name of the function that it points to.
macro_rules! functions {
    ($($name:ident: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// A loaded library's functions.
        #[allow(non_snake_case, reason = "these are the names in C")]
        pub(crate) struct Functions {
            $(pub(super) $name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            /// Never unloaded: the library's threads may outlive its objects.
            _library: ManuallyDrop<Library>,
        }

        impl Functions {
            fn of(library: Library) -> Result<Self, &'static str> {
                Ok(Self {
                    // SAFETY: a function of this name is declared so in version 2's header.
                    $($name: unsafe { library.get(concat!(stringify!($name), "\0").as_bytes()) }
                        .map(|function| *function)
                        .map_err(|_| stringify!($name))?,)*
                    _library: ManuallyDrop::new(library),
                })
            }
        }
    };
}

functions! {
    oidnNewDevice: fn(c_int) -> *mut DeviceObject;
    oidnCommitDevice: fn(*mut DeviceObject);
    oidnGetDeviceInt: fn(*mut DeviceObject, *const c_char) -> c_int;
    oidnGetDeviceError: fn(*mut DeviceObject, *mut *const c_char) -> c_int;
    oidnReleaseDevice: fn(*mut DeviceObject);
    oidnNewBuffer: fn(*mut DeviceObject, usize) -> *mut BufferObject;
    oidnWriteBuffer: fn(*mut BufferObject, usize, usize, *const c_void);
    oidnReadBuffer: fn(*mut BufferObject, usize, usize, *mut c_void);
    oidnReleaseBuffer: fn(*mut BufferObject);
    oidnNewFilter: fn(*mut DeviceObject, *const c_char) -> *mut FilterObject;
    oidnSetFilterImage: fn(
        *mut FilterObject, *const c_char, *mut BufferObject, c_int, usize, usize, usize, usize, usize
    );
    oidnSetFilterBool: fn(*mut FilterObject, *const c_char, bool);
    oidnSetFilterInt: fn(*mut FilterObject, *const c_char, c_int);
    oidnSetFilterFloat: fn(*mut FilterObject, *const c_char, f32);
    oidnGetFilterInt: fn(*mut FilterObject, *const c_char) -> c_int;
    oidnCommitFilter: fn(*mut FilterObject);
    oidnExecuteFilter: fn(*mut FilterObject);
    oidnReleaseFilter: fn(*mut FilterObject);
}

impl Functions {
    /// Loads a library, which stays loaded as long as the process lives.
    pub(crate) fn load(path: &Path) -> Result<Self, LoadError> {
        let library = open(path).map_err(|error| LoadError::Loader(error.to_string()))?;
        // Version 2 renamed this function; `oidnNewDevice` and others are in both.
        // SAFETY: the symbol's address is not used.
        let is_old = unsafe { library.get::<*const c_void>(b"oidnGetDevice1i\0") }.is_ok();
        if is_old {
            return Err(LoadError::VersionOne);
        }
        Self::of(library).map_err(LoadError::Function)
    }
}

/// With all of the functions that it needs itself, so that none is found missing later.
#[cfg(unix)]
fn open(path: &Path) -> Result<Library, libloading::Error> {
    use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};

    // SAFETY: that the library's initialisation is sound can only be trusted; whoever calls
    // this has said which file it is.
    unsafe { Library::open(Some(path), RTLD_NOW | RTLD_LOCAL) }.map(Into::into)
}

/// With the libraries beside it.
#[cfg(windows)]
fn open(path: &Path) -> Result<Library, libloading::Error> {
    use libloading::os::windows::{LOAD_WITH_ALTERED_SEARCH_PATH, Library};

    // SAFETY: as for Unix.
    let open =
        |path: &Path| unsafe { Library::load_with_flags(path, LOAD_WITH_ALTERED_SEARCH_PATH) };
    // The library loads this file itself, but finds the one of Intel's threads, which it
    // needs, only if that is loaded already. Where it cannot be, the library will say so.
    if let Ok(device) = open(&path.with_file_name("OpenImageDenoise_device_cpu.dll")) {
        std::mem::forget(device);
    }
    open(path).map(Into::into)
}
