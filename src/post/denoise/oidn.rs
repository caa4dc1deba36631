//! Intel's Open Image Denoise, found at run time: its `RTLightmap` filter, by the C interface of version 2
//! (<https://www.openimagedenoise.org/documentation.html>, "API").
//!
//! Each chart is filtered as a picture of its own, what lies around it in its box filled from it: no light crosses a chart. Charts
//! too small to be a picture stay as they are.
#![allow(unsafe_code)]

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::light::Lit;
use crate::post::gutter::push_pull;
use crate::progress::Progress;
use libloading::Library;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::Path;

/// Names that the library goes by, where no path is given.
const NAMES: [&str; 6] = [
    "libOpenImageDenoise.so.2",
    "libOpenImageDenoise.so",
    "libOpenImageDenoise.2.dylib",
    "libOpenImageDenoise.dylib",
    "OpenImageDenoise.dll",
    "OpenImageDenoise",
];

/// The environment variable that names the library.
const VARIABLE: &str = "LUMEL_OIDN";

/// Charts with fewer texels a side than this are left as they are.
const LEAST_SIDE: usize = 8;

/// Texels around a chart's box.
const MARGIN: usize = 4;

/// `OIDN_DEVICE_TYPE_CPU` and `OIDN_FORMAT_FLOAT3`.
const CPU: c_int = 1;
const FLOAT3: c_int = 3;

type Handle = *mut c_void;

/// An open library with a device.
pub struct Oidn {
    calls: Calls,
    device: Handle,
    version: [c_int; 2],
    // Last, so that it is closed last.
    _library: Library,
}

/// The functions that are used.
struct Calls {
    commit_device: unsafe extern "C" fn(Handle),
    release_device: unsafe extern "C" fn(Handle),
    device_error: unsafe extern "C" fn(Handle, *mut *const c_char) -> c_int,
    device_int: unsafe extern "C" fn(Handle, *const c_char) -> c_int,
    new_filter: unsafe extern "C" fn(Handle, *const c_char) -> Handle,
    #[allow(clippy::type_complexity)]
    set_image: unsafe extern "C" fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize),
    set_bool: unsafe extern "C" fn(Handle, *const c_char, bool),
    commit_filter: unsafe extern "C" fn(Handle),
    execute_filter: unsafe extern "C" fn(Handle),
    release_filter: unsafe extern "C" fn(Handle),
}

impl Oidn {
    /// Opens the library at `path`, or at `LUMEL_OIDN`, or by its usual names.
    ///
    /// # Errors
    /// `Invalid` where there is none, or it is not version 2.
    pub fn open(path: Option<&Path>) -> Result<Self> {
        let named = path.map(Path::to_path_buf).or_else(|| std::env::var_os(VARIABLE).map(Into::into));
        let library = match &named {
            // SAFETY: opening runs the library's initialisers; the user named it, and Open Image Denoise's have no demands.
            Some(path) => unsafe { Library::new(path) }.map_err(|e| Error::invalid(path.display(), e))?,
            // SAFETY: as above, of a library that the system knows by this name.
            None => NAMES.iter().find_map(|name| unsafe { Library::new(*name) }.ok()).ok_or_else(|| {
                let message = "the library of Open Image Denoise was not found; give it with --oidn-library or \
                               LUMEL_OIDN, or choose --denoise builtin";
                Error::invalid("denoise", message)
            })?,
        };
        let name = named.map_or_else(|| "Open Image Denoise".to_string(), |path| path.display().to_string());
        let wrong = |e: libloading::Error| Error::invalid(&name, format!("is not Open Image Denoise 2: {e}"));
        let calls = Calls::of(&library).map_err(wrong)?;
        // SAFETY: the type of `oidnNewDevice` in oidn.h of version 2.
        let new = unsafe { library.get::<unsafe extern "C" fn(c_int) -> Handle>(b"oidnNewDevice\0") }.map_err(wrong)?;
        // SAFETY: any type of device may be asked for; null is returned where there is none.
        let device = unsafe { new(CPU) };
        if device.is_null() {
            return Err(Error::invalid(name, "has no device for this processor; choose --denoise builtin"));
        }
        let mut oidn = Self { calls, device, version: [0; 2], _library: library };
        // SAFETY: the device is live and not null.
        unsafe { (oidn.calls.commit_device)(device) };
        oidn.check()?;
        // SAFETY: the device is committed; the names are parameters of every device.
        oidn.version =
            [c"versionMajor", c"versionMinor"].map(|n| unsafe { (oidn.calls.device_int)(device, n.as_ptr()) });
        Ok(oidn)
    }

    /// For the report.
    pub fn name(&self) -> String {
        format!("Open Image Denoise {}.{}", self.version[0], self.version[1])
    }

    /// Filters `light`, one value a patch, chart by chart.
    ///
    /// # Errors
    /// `Invalid` with what the library says; `Cancelled`.
    pub fn filter(&self, lit: &Lit, light: &mut [Rgb], progress: &dyn Progress) -> Result<()> {
        let charts = &lit.ground.patches.chart;
        let mut first = 0;
        for chart in charts.chunk_by(|a, b| a == b) {
            progress.check()?;
            let range = first..first + chart.len();
            first = range.end;
            let places: Vec<[usize; 2]> = range.clone().map(|i| lit.ground.column_row(i).map(|c| c as usize)).collect();
            let bound =
                |pick: fn(usize, usize) -> usize, k: usize| places.iter().map(|p| p[k]).reduce(pick).unwrap_or(0);
            let low = [bound(usize::min, 0), bound(usize::min, 1)];
            let high = [bound(usize::max, 0), bound(usize::max, 1)];
            let size = [0, 1].map(|k| high[k] - low[k] + 1 + 2 * MARGIN);
            if size.iter().any(|n| *n < LEAST_SIDE + 2 * MARGIN) {
                continue;
            }
            let texel = |p: &[usize; 2]| (p[1] - low[1] + MARGIN) * size[0] + p[0] - low[0] + MARGIN;
            let (mut picture, mut filled) = (vec![Rgb::ZERO; size[0] * size[1]], vec![false; size[0] * size[1]]);
            for (i, place) in range.clone().zip(&places).filter(|(i, _)| !lit.exposure.is_buried(*i)) {
                (picture[texel(place)], filled[texel(place)]) = (light[i], true);
            }
            push_pull(size, &mut picture, &filled);
            let result = self.picture(size, &mut picture)?;
            for (i, place) in range.zip(&places).filter(|(i, _)| !lit.exposure.is_buried(*i)) {
                light[i] = result[texel(place)].max(Rgb::ZERO);
            }
        }
        Ok(())
    }

    /// One picture of `size` through the filter `RTLightmap`.
    fn picture(&self, size: [usize; 2], picture: &mut [Rgb]) -> Result<Vec<Rgb>> {
        assert_eq!(picture.len(), size[0] * size[1], "a picture holds all its texels");
        let mut result = vec![Rgb::ZERO; picture.len()];
        let Calls { new_filter, set_image, set_bool, commit_filter, execute_filter, release_filter, .. } = self.calls;
        // SAFETY: the device is live. Both pictures hold width x height triples of f32 without gaps (`glam::Vec3` is repr(C)),
        // which is what FLOAT3 with strides of 0 says, and outlive the filter, which is released here; a null filter is not used.
        unsafe {
            let filter = new_filter(self.device, c"RTLightmap".as_ptr());
            if !filter.is_null() {
                let (input, output) = (picture.as_mut_ptr().cast(), result.as_mut_ptr().cast());
                set_image(filter, c"color".as_ptr(), input, FLOAT3, size[0], size[1], 0, 0, 0);
                set_image(filter, c"output".as_ptr(), output, FLOAT3, size[0], size[1], 0, 0, 0);
                set_bool(filter, c"directional".as_ptr(), false);
                commit_filter(filter);
                execute_filter(filter);
                release_filter(filter);
            }
        }
        self.check()?;
        Ok(result)
    }

    /// What went wrong since the last time.
    fn check(&self) -> Result<()> {
        let mut message = std::ptr::null();
        // SAFETY: the device is live, and `message` may be written to.
        let code = unsafe { (self.calls.device_error)(self.device, &mut message) };
        if code == 0 {
            return Ok(());
        }
        let text = match message.is_null() {
            true => format!("error {code}"),
            // SAFETY: the library's messages end with 0 and live until the next call.
            false => unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned(),
        };
        Err(Error::invalid("Open Image Denoise", text))
    }
}

impl Drop for Oidn {
    fn drop(&mut self) {
        // SAFETY: the device is live, and nothing uses it any more.
        unsafe { (self.calls.release_device)(self.device) };
    }
}

impl Calls {
    /// Finds the functions in `library`.
    fn of(library: &Library) -> std::result::Result<Self, libloading::Error> {
        // SAFETY: the types of the fields are those of the functions in oidn.h of version 2, and the library outlives them.
        unsafe {
            Ok(Self {
                commit_device: *library.get(b"oidnCommitDevice\0")?,
                release_device: *library.get(b"oidnReleaseDevice\0")?,
                device_error: *library.get(b"oidnGetDeviceError\0")?,
                device_int: *library.get(b"oidnGetDeviceInt\0")?,
                new_filter: *library.get(b"oidnNewFilter\0")?,
                set_image: *library.get(b"oidnSetSharedFilterImage\0")?,
                set_bool: *library.get(b"oidnSetFilterBool\0")?,
                commit_filter: *library.get(b"oidnCommitFilter\0")?,
                execute_filter: *library.get(b"oidnExecuteFilter\0")?,
                release_filter: *library.get(b"oidnReleaseFilter\0")?,
            })
        }
    }
}
