//! What denoises.

use std::{
    ffi::CStr,
    fmt,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use crate::{
    Error, Image, Library, Version,
    ffi::{self, Buffer, Failure, Filter},
    image::{CHANNELS, not_finite},
};

/// On which processor a device computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DeviceKind {
    /// The CPU.
    Cpu,
    /// A GPU by Intel.
    Sycl,
    /// A GPU by NVIDIA.
    Cuda,
    /// A GPU by AMD.
    Hip,
    /// A GPU by Apple.
    Metal,
    /// One that this crate does not know, by its number.
    Other(i32),
}

impl DeviceKind {
    /// From `OIDNDeviceType`.
    fn from_type(number: i32) -> Self {
        match number {
            1 => Self::Cpu,
            2 => Self::Sycl,
            3 => Self::Cuda,
            4 => Self::Hip,
            5 => Self::Metal,
            number => Self::Other(number),
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("CPU"),
            Self::Sycl => f.write_str("SYCL"),
            Self::Cuda => f.write_str("CUDA"),
            Self::Hip => f.write_str("HIP"),
            Self::Metal => f.write_str("Metal"),
            Self::Other(number) => write!(f, "device of type {number}"),
        }
    }
}

/// A device of the library. Threads may share it; they denoise one after the other.
pub struct Device {
    path: PathBuf,
    version: Version,
    kind: DeviceKind,
    /// What the last picture was denoised by: the next of its kind needs nothing new.
    prepared: Mutex<Option<Prepared>>,
    device: Arc<ffi::Device>,
}

impl Device {
    /// The device that Open Image Denoise prefers on this machine. The environment variable
    /// `OIDN_DEFAULT_DEVICE` (`cpu`, `cuda`, …), which it reads, chooses another.
    ///
    /// # Errors
    /// [`Error::Device`], or [`Error::Version`] if the library is not of version 2.
    pub fn new(library: &Library) -> Result<Self, Error> {
        let path = library.path().to_owned();
        let failed = |Failure(reason)| Error::Device { path: path.clone(), reason };
        let device = ffi::Device::new(library.functions()).map_err(failed)?;
        let version = Version::from_digits(device.int(c"version").map_err(failed)?);
        if version.major != 2 {
            return Err(Error::Version { path, version });
        }
        let kind = DeviceKind::from_type(device.int(c"type").map_err(failed)?);
        Ok(Self { path, version, kind, prepared: Mutex::default(), device: Arc::new(device) })
    }

    /// The library's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The library's version.
    #[must_use]
    pub fn version(&self) -> Version {
        self.version
    }

    /// Where it computes.
    #[must_use]
    pub fn kind(&self) -> DeviceKind {
        self.kind
    }

    /// Denoises a picture; `out` has the layout of its colours. Pictures of one kind (size,
    /// layers and options) are best denoised one after the other: they share all that has to
    /// be prepared.
    ///
    /// # Errors
    /// [`Error::Size`], [`Error::Length`], [`Error::NotFinite`] or [`Error::NormalAlone`] if
    /// something is wrong with the picture; [`Error::Failed`] or [`Error::Rubbish`] if the
    /// library fails, and what is in `out` has no meaning then.
    pub fn denoise(&self, image: &Image<'_>, out: &mut [f32]) -> Result<(), Error> {
        image.check(out)?;
        let mut slot = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        // Whatever fails, the next picture begins anew.
        let reusable = slot.take().filter(|prepared| prepared.kind == Kind::of(image));
        let failed = |(action, Failure(reason)): Step| {
            let path = self.path.clone();
            Error::Failed { path, action, reason }
        };
        let prepared = match reusable {
            Some(prepared) => prepared,
            None => Prepared::new(&self.device, Kind::of(image)).map_err(failed)?,
        };
        prepared.run(image, out).map_err(failed)?;
        match not_finite(out) {
            0 => *slot = Some(prepared),
            count => return Err(Error::Rubbish { path: self.path.clone(), count }),
        }
        Ok(())
    }
}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut debug = f.debug_struct("Device");
        debug.field("path", &self.path).field("version", &self.version).field("kind", &self.kind);
        debug.finish_non_exhaustive()
    }
}

/// What decides whether two pictures can share a filter.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Kind {
    width: usize,
    height: usize,
    albedo: bool,
    normal: bool,
    hdr: bool,
    clean_aux: bool,
}

impl Kind {
    fn of(image: &Image<'_>) -> Self {
        let &Image { width, height, albedo, normal, hdr, clean_aux, .. } = image;
        Self { width, height, albedo: albedo.is_some(), normal: normal.is_some(), hdr, clean_aux }
    }
}

/// What failed, in words that follow "failed to", and why.
type Step = (&'static str, Failure);

/// A filter, and the memory of its pictures. Buffers serve on every device, while most GPUs
/// cannot read the host's memory; a copy costs little beside the network.
struct Prepared {
    kind: Kind,
    filter: Filter,
    color: Buffer,
    albedo: Option<Buffer>,
    normal: Option<Buffer>,
    output: Buffer,
}

impl Prepared {
    fn new(device: &Arc<ffi::Device>, kind: Kind) -> Result<Self, Step> {
        let size = (kind.width, kind.height);
        let filter = Filter::new(device).map_err(|why| ("make a filter", why))?;
        let buffer = |name: &CStr| {
            let buffer = Buffer::new(device, CHANNELS * kind.width * kind.height)
                .map_err(|why| ("allocate memory for a picture", why))?;
            let set = filter.set_image(name, &buffer, size);
            set.map_err(|why| ("give the filter a picture", why)).map(|()| buffer)
        };
        let color = buffer(c"color")?;
        let albedo = kind.albedo.then(|| buffer(c"albedo")).transpose()?;
        let normal = kind.normal.then(|| buffer(c"normal")).transpose()?;
        let output = buffer(c"output")?;
        for (name, value) in [(c"hdr", kind.hdr), (c"cleanAux", kind.clean_aux)] {
            filter.set_bool(name, value).map_err(|why| ("set an option", why))?;
        }
        filter.commit().map_err(|why| ("prepare the filter", why))?;
        Ok(Self { kind, filter, color, albedo, normal, output })
    }

    fn run(&self, image: &Image<'_>, out: &mut [f32]) -> Result<(), Step> {
        let inputs = [
            (Some(&self.color), Some(image.color)),
            (self.albedo.as_ref(), image.albedo),
            (self.normal.as_ref(), image.normal),
        ];
        for (buffer, values) in inputs {
            if let (Some(buffer), Some(values)) = (buffer, values) {
                buffer.write(values).map_err(|why| ("copy a picture to the device", why))?;
            }
        }
        self.filter.execute().map_err(|why| ("denoise", why))?;
        self.output.read(out).map_err(|why| ("copy the picture from the device", why))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_names() {
        let kinds = (1..7).map(|number| DeviceKind::from_type(number).to_string());
        let names = ["CPU", "SYCL", "CUDA", "HIP", "Metal", "device of type 6"];
        assert!(kinds.eq(names));
    }

    /// Threads share devices.
    #[test]
    fn devices_cross_threads() {
        fn crosses<T: Send + Sync>() {}
        crosses::<Device>();
        crosses::<Library>();
    }
}
