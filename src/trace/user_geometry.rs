//! An [`Intersector`] as an Embree user geometry.
#![allow(unsafe_code)]

use std::any::Any;
use std::ffi::c_void;
use std::sync::Arc;

use embree4_sys as sys;

use super::device::Device;
use super::geometry::{Geometry, Handle, Kind, check_key_count};
use super::panics::PanicSlot;
use super::scene::{Query, UserHit};
use crate::accel::Intersector;
use crate::error::Result;
use crate::math::{Bounds3, Ray, Vec3};

/// What the callbacks borrow. Owned by the geometry, hence by the scene.
struct User<I> {
    intersector: Arc<I>,
    panics: Arc<PanicSlot>,
}

impl Geometry {
    /// A surface that `intersector` meets rays with. A panic in it counts as a miss (or as empty bounds) and is
    /// kept for [`Scene::take_panic`](super::Scene::take_panic).
    ///
    /// # Errors
    /// If it has too many motion keys, or memory runs out.
    pub fn user<I: Intersector + 'static>(device: &Device, intersector: Arc<I>) -> Result<Self> {
        let keys = intersector.keys() as usize;
        check_key_count(keys)?;
        let handle = Handle::new(device, sys::RTC_GEOMETRY_TYPE_USER)?;
        handle.set_keys(keys);
        let panics = Arc::<PanicSlot>::default();
        let primitives = intersector.primitives();
        let user = Box::new(User {
            intersector,
            panics: Arc::clone(&panics),
        });
        let pointer: *const User<I> = &raw const *user;
        // SAFETY: the geometry is alive. The box stays where it is until the geometry and the scene are released
        // (field order in `Geometry` and `Scene`), and the callbacks only borrow it.
        unsafe {
            sys::rtcSetGeometryUserPrimitiveCount(handle.raw(), primitives);
            sys::rtcSetGeometryUserData(handle.raw(), pointer.cast_mut().cast::<c_void>());
            sys::rtcSetGeometryBoundsFunction(
                handle.raw(),
                Some(bounds::<I>),
                std::ptr::null_mut(),
            );
            sys::rtcSetGeometryIntersectFunction(handle.raw(), Some(intersect::<I>));
            sys::rtcSetGeometryOccludedFunction(handle.raw(), Some(occluded::<I>));
        }
        handle.commit()?;
        let owned: Box<dyn Any + Send + Sync> = user;
        let mut geometry = Self::from_parts(handle, Kind::User(owned), keys);
        geometry.panics = panics;
        Ok(geometry)
    }
}

unsafe extern "C" fn bounds<I: Intersector>(args: *const sys::RTCBoundsFunctionArguments) {
    // SAFETY: Embree's arguments are valid during the call, and its user pointer is the one set above.
    let (args, user) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<User<I>>()) };
    let b = user.panics.guard(Bounds3::EMPTY, || {
        user.intersector.bounds(args.primID, args.timeStep)
    });
    // SAFETY: Embree wants one box written here.
    let out = unsafe { &mut *args.bounds_o };
    [out.lower_x, out.lower_y, out.lower_z] = b.min.to_array();
    [out.upper_x, out.upper_y, out.upper_z] = b.max.to_array();
}

unsafe extern "C" fn intersect<I: Intersector>(args: *const sys::RTCIntersectFunctionNArguments) {
    // SAFETY: as for `bounds`.
    let (args, user) = unsafe { (&*args, &*args_user::<I>((*args).geometryUserPtr)) };
    assert_single(args.N);
    // SAFETY: N is 1, so these are one number and one RTCRayHit, ours alone during the call.
    let (valid, both) = unsafe { (&mut *args.valid, &mut *args.rayhit.cast::<sys::RTCRayHit>()) };
    if *valid == 0 {
        return;
    }
    *valid = 0;
    // The ray is made on the inner side of the guard, where the compiler can keep it in registers.
    let Some(hit) = user.panics.guard(None, || {
        user.intersector.intersect(args.primID, &ray_of(&both.ray))
    }) else {
        return;
    };
    // Embree's boxes are only as good as its tfar: a hit beyond it must not replace a nearer one.
    if !(hit.t > both.ray.tnear && hit.t < both.ray.tfar) {
        return;
    }
    *valid = -1;
    both.ray.tfar = hit.t;
    let to = &mut both.hit;
    [to.Ng_x, to.Ng_y, to.Ng_z] = hit.normal.to_array();
    [to.u, to.v] = hit.uv.to_array();
    to.primID = args.primID;
    to.geomID = args.geomID;
    // SAFETY: every query of this crate passes the context at the start of a `Query` (scene.rs), which is not
    // otherwise borrowed while Embree runs.
    let query = unsafe { &mut *args.context.cast::<Query>() };
    to.instID[0] = query.context.instID[0];
    query.user = Some(UserHit {
        geometry: args.geomID,
        instance: query.context.instID[0],
        primitive: args.primID,
        t: hit.t,
        face: hit.face,
        error: hit.error,
    });
}

unsafe extern "C" fn occluded<I: Intersector>(args: *const sys::RTCOccludedFunctionNArguments) {
    // SAFETY: as for `bounds`.
    let (args, user) = unsafe { (&*args, &*args_user::<I>((*args).geometryUserPtr)) };
    assert_single(args.N);
    // SAFETY: N is 1, so these are one number and one RTCRay, ours alone during the call.
    let (valid, raw) = unsafe { (&mut *args.valid, &mut *args.ray.cast::<sys::RTCRay>()) };
    if *valid == 0 {
        return;
    }
    *valid = 0;
    if user.panics.guard(false, || {
        user.intersector.occluded(args.primID, &ray_of(raw))
    }) {
        *valid = -1;
        raw.tfar = f32::NEG_INFINITY;
    }
}

fn args_user<I>(pointer: *mut c_void) -> *const User<I> {
    pointer.cast_const().cast()
}

/// Queries are single rays (scene.rs). A packet would be a bug that must not go on, so this ends the process:
/// panics do not cross `extern "C"`.
fn assert_single(n: u32) {
    assert_eq!(n, 1, "a packet of rays in a callback for single rays");
}

fn ray_of(r: &sys::RTCRay) -> Ray {
    Ray {
        origin: Vec3::new(r.org_x, r.org_y, r.org_z),
        direction: Vec3::new(r.dir_x, r.dir_y, r.dir_z),
        t_min: r.tnear,
        t_max: r.tfar,
        time: r.time,
    }
}
