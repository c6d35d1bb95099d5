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
    /// In MB; -1: no limit.
    max_memory: i32,
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
        let (prepared, device) = (Mutex::default(), Arc::new(device));
        Ok(Self { path, version, kind, max_memory: -1, prepared, device })
    }

    /// The same with a limit of the memory, in MB, that it takes beside pictures and networks. It
    /// divides larger pictures into tiles, which takes longer; very low limits are not kept.
    #[must_use]
    pub fn with_max_memory(self, megabytes: u16) -> Self {
        Self { max_memory: megabytes.into(), ..self }
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
        self.with_prepared(image, |prepared| {
            prepared.run(image, out).map_err(|step| self.failed(step))?;
            match not_finite(out) {
                0 => Ok(()),
                count => Err(Error::Rubbish { path: self.path.clone(), count }),
            }
        })
    }

    /// How pictures of this one's kind are denoised in parts.
    ///
    /// # Errors
    /// Those of [`Self::denoise`].
    pub fn tiling(&self, image: &Image<'_>) -> Result<Tiling, Error> {
        image.check(image.color)?;
        self.with_prepared(image, |prepared| prepared.tiling().map_err(|step| self.failed(step)))
    }

    /// Uses what pictures of a kind are denoised by.
    fn with_prepared<T>(
        &self,
        image: &Image<'_>,
        work: impl FnOnce(&Prepared) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let mut slot = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        let kind = Kind::of(image, self.max_memory);
        // Whatever fails, the next picture begins anew.
        let reusable = slot.take().filter(|prepared| prepared.kind == kind);
        let prepared = match reusable {
            Some(prepared) => prepared,
            None => Prepared::new(&self.device, kind).map_err(|step| self.failed(step))?,
        };
        let result = work(&prepared)?;
        *slot = Some(prepared);
        Ok(result)
    }

    fn failed(&self, (action, Failure(reason)): Step) -> Error {
        Error::Failed { path: self.path.clone(), action, reason }
    }
}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut debug = f.debug_struct("Device");
        debug.field("path", &self.path).field("version", &self.version).field("kind", &self.kind);
        debug.finish_non_exhaustive()
    }
}

/// How pictures are denoised in parts, bands of their rows for example, so that the values are
/// those of the whole picture: parts begin at multiples of the alignment, and have as many
/// further rows and columns on each side as the overlap says, or all that there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    /// In pixels, at least 1.
    pub alignment: u32,
    /// In pixels.
    pub overlap: u32,
}

/// What decides whether two pictures can share a filter.
#[derive(Clone, Copy, PartialEq)]
struct Kind {
    width: usize,
    height: usize,
    albedo: bool,
    normal: bool,
    hdr: bool,
    input_scale: Option<f32>,
    clean_aux: bool,
    max_memory: i32,
}

impl Kind {
    fn of(image: &Image<'_>, max_memory: i32) -> Self {
        let &Image { width, height, hdr, input_scale, clean_aux, .. } = image;
        let [albedo, normal] = [image.albedo, image.normal].map(|layer| layer.is_some());
        Self { width, height, albedo, normal, hdr, input_scale, clean_aux, max_memory }
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
        let max_memory = filter.set_int(c"maxMemoryMB", kind.max_memory);
        max_memory.map_err(|why| ("limit its memory", why))?;
        if let Some(scale) = kind.input_scale {
            filter.set_float(c"inputScale", scale).map_err(|why| ("set the scale", why))?;
        }
        filter.commit().map_err(|why| ("prepare the filter", why))?;
        Ok(Self { kind, filter, color, albedo, normal, output })
    }

    fn tiling(&self) -> Result<Tiling, Step> {
        let number = |name: &CStr| {
            let number =
                self.filter.int(name).map_err(|why| ("say how pictures are divided", why))?;
            Ok(u32::try_from(number).unwrap_or_default())
        };
        Ok(Tiling { alignment: number(c"tileAlignment")?.max(1), overlap: number(c"tileOverlap")? })
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
