//! The few calls of Embree 4's C interface that the bench needs, loaded at run time: Embree is a peer to measure against, never
//! a part of the baker.
#![allow(unsafe_code)]

use libloading::Library;
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::ptr::null_mut;

/// `RTCRay` followed by `RTCHit`. Larger than the library's, whose end depends on how it was built.
#[repr(C, align(16))]
#[derive(Clone, Copy)]
struct RayHit {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    uv: [f32; 2],
    primitive: u32,
    geometry: u32,
    instance: [u32; 5],
}

/// `RTCRayHit16`: the same in structures of arrays.
#[repr(C, align(64))]
struct RayHit16 {
    origin: [[f32; 16]; 3],
    near: [f32; 16],
    direction: [[f32; 16]; 3],
    time: [f32; 16],
    far: [f32; 16],
    mask: [u32; 16],
    id: [u32; 16],
    flags: [u32; 16],
    normal: [[f32; 16]; 3],
    uv: [[f32; 16]; 2],
    primitive: [u32; 16],
    geometry: [u32; 16],
    instance: [[u32; 16]; 4],
}

/// Which lanes of a packet count (-1).
#[repr(C, align(64))]
struct Valid([i32; 16]);

const ROBUST: u32 = 1 << 2;
const HIGH_QUALITY: u32 = 2;
const TRIANGLES: u32 = 0;
const INDICES: u32 = 0;
const VERTICES: u32 = 1;
const UINT3: u32 = 0x5003;
const FLOAT3: u32 = 0x9003;
const NONE: u32 = u32::MAX;

type Query1 = unsafe extern "C" fn(*mut c_void, *mut RayHit, *mut c_void);
type Query16 = unsafe extern "C" fn(*const i32, *mut c_void, *mut RayHit16, *mut c_void);

/// A committed scene of triangles.
pub struct Embree {
    scene: *mut c_void,
    intersect1: Query1,
    occluded1: Query1,
    intersect16: Query16,
    occluded16: Query16,
}

// SAFETY: Embree allows queries of a committed scene from any number of threads.
unsafe impl Sync for Embree {}

/// A ray from `origin` along `direction` up to `length`.
#[derive(Clone, Copy)]
pub struct Span {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    pub length: f32,
}

impl Embree {
    /// Builds the scene at high quality, robust.
    pub fn new(library: &Path, triangles: &[[[f32; 3]; 3]]) -> Result<Self, libloading::Error> {
        type Handle = *mut c_void;
        // SAFETY: the signatures are those of Embree 4's headers, and the buffers are filled to the counts they were made with.
        unsafe {
            let library = Library::new(library)?;
            let device = library.get::<unsafe extern "C" fn(*const c_char) -> Handle>(b"rtcNewDevice\0")?(c"".as_ptr());
            let scene = library.get::<unsafe extern "C" fn(Handle) -> Handle>(b"rtcNewScene\0")?(device);
            library.get::<unsafe extern "C" fn(Handle, u32)>(b"rtcSetSceneFlags\0")?(scene, ROBUST);
            library.get::<unsafe extern "C" fn(Handle, u32)>(b"rtcSetSceneBuildQuality\0")?(scene, HIGH_QUALITY);
            let geometry =
                library.get::<unsafe extern "C" fn(Handle, u32) -> Handle>(b"rtcNewGeometry\0")?(device, TRIANGLES);
            let buffer = library.get::<unsafe extern "C" fn(Handle, u32, u32, u32, usize, usize) -> Handle>(
                b"rtcSetNewGeometryBuffer\0",
            )?;
            let vertices = buffer(geometry, VERTICES, 0, FLOAT3, 12, 3 * triangles.len()).cast::<[[f32; 3]; 3]>();
            vertices.copy_from_nonoverlapping(triangles.as_ptr(), triangles.len());
            let indices = buffer(geometry, INDICES, 0, UINT3, 12, triangles.len()).cast::<u32>();
            for i in 0..3 * triangles.len() {
                indices.add(i).write(i as u32);
            }
            library.get::<unsafe extern "C" fn(Handle)>(b"rtcCommitGeometry\0")?(geometry);
            library.get::<unsafe extern "C" fn(Handle, Handle) -> u32>(b"rtcAttachGeometry\0")?(scene, geometry);
            library.get::<unsafe extern "C" fn(Handle)>(b"rtcCommitScene\0")?(scene);
            let embree = Self {
                scene,
                intersect1: *library.get(b"rtcIntersect1\0")?,
                occluded1: *library.get(b"rtcOccluded1\0")?,
                intersect16: *library.get(b"rtcIntersect16\0")?,
                occluded16: *library.get(b"rtcOccluded16\0")?,
            };
            // Its threads outlive the scene: the code must stay.
            std::mem::forget(library);
            Ok(embree)
        }
    }

    /// The triangle that each ray meets first, one ray a call.
    pub fn closest(&self, spans: &[Span], hits: &mut [Option<u32>]) {
        for (span, hit) in spans.iter().zip(hits) {
            let mut ray = RayHit::new(span);
            // SAFETY: the scene is committed, the ray laid out and aligned as the library has it.
            unsafe { (self.intersect1)(self.scene, &mut ray, null_mut()) };
            *hit = (ray.geometry != NONE).then_some(ray.primitive);
        }
    }

    /// Whether each ray is blocked within its length, one ray a call.
    pub fn occluded(&self, spans: &[Span], blocked: &mut [bool]) {
        for (span, blocked) in spans.iter().zip(blocked) {
            let mut ray = RayHit::new(span);
            // SAFETY: as in `closest`.
            unsafe { (self.occluded1)(self.scene, &mut ray, null_mut()) };
            *blocked = ray.far < 0.0;
        }
    }

    /// [`Embree::closest`] in packets of sixteen.
    pub fn closest16(&self, spans: &[Span], hits: &mut [Option<u32>]) {
        for (spans, hits) in spans.chunks(16).zip(hits.chunks_mut(16)) {
            let (mut packet, valid) = RayHit16::new(spans);
            // SAFETY: as in `closest`.
            unsafe { (self.intersect16)(valid.0.as_ptr(), self.scene, &mut packet, null_mut()) };
            for (i, hit) in hits.iter_mut().enumerate() {
                *hit = (packet.geometry[i] != NONE).then_some(packet.primitive[i]);
            }
        }
    }

    /// [`Embree::occluded`] in packets of sixteen.
    pub fn occluded16(&self, spans: &[Span], blocked: &mut [bool]) {
        for (spans, blocked) in spans.chunks(16).zip(blocked.chunks_mut(16)) {
            let (mut packet, valid) = RayHit16::new(spans);
            // SAFETY: as in `closest`.
            unsafe { (self.occluded16)(valid.0.as_ptr(), self.scene, &mut packet, null_mut()) };
            for (i, blocked) in blocked.iter_mut().enumerate() {
                *blocked = packet.far[i] < 0.0;
            }
        }
    }
}

impl RayHit {
    fn new(span: &Span) -> Self {
        Self {
            origin: span.origin,
            near: 0.0,
            direction: span.direction,
            time: 0.0,
            far: span.length,
            mask: u32::MAX,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            uv: [0.0; 2],
            primitive: NONE,
            geometry: NONE,
            instance: [NONE; 5],
        }
    }
}

impl RayHit16 {
    fn new(spans: &[Span]) -> (Self, Valid) {
        let of = |value: fn(&Span) -> f32| std::array::from_fn(|i| spans.get(i).map_or(0.0, value));
        let packet = Self {
            origin: [of(|s| s.origin[0]), of(|s| s.origin[1]), of(|s| s.origin[2])],
            near: [0.0; 16],
            direction: [of(|s| s.direction[0]), of(|s| s.direction[1]), of(|s| s.direction[2])],
            time: [0.0; 16],
            far: of(|s| s.length),
            mask: [u32::MAX; 16],
            id: [0; 16],
            flags: [0; 16],
            normal: [[0.0; 16]; 3],
            uv: [[0.0; 16]; 2],
            primitive: [NONE; 16],
            geometry: [NONE; 16],
            instance: [[NONE; 16]; 4],
        };
        (packet, Valid(std::array::from_fn(|i| if i < spans.len() { -1 } else { 0 })))
    }
}
