//! Limit points by OpenSubdiv's Far: a patch table made beforehand, `FindPatch`, `EvaluateBasis`, weighted sums.
//!
//! It serves benchmarks that compare with it, and nothing else; it needs Debian's libosd-dev.

use std::ffi::{c_int, c_void};
use std::marker::PhantomData;
use std::ptr::NonNull;

/// A surface in single or double precision.
pub struct Far<T: Real> {
    surface: NonNull<c_void>,
    ptex_faces: c_int,
    real: PhantomData<T>,
}

/// Single or double precision.
pub trait Real: Copy + Default + sealed::Border {}

impl Real for f32 {}
impl Real for f64 {}

impl<T: Real> Far<T> {
    /// The surface of a closed or open mesh of quads, or by Loop's scheme of triangles, refined adaptively to `level`.
    /// Border edges and points with one face are sharp.
    ///
    /// # Panics
    /// If numbers do not fit, or OpenSubdiv refuses the mesh.
    pub fn new(triangles: bool, faces: &[u32], positions: &[[f32; 3]], level: u32) -> Self {
        let sides = if triangles { 3 } else { 4 };
        assert_eq!(faces.len() % sides, 0, "faces of {sides} corners");
        let count = faces.len() / sides;
        let int = |n: usize| c_int::try_from(n).expect("numbers of 31 bits");
        let indices: Vec<c_int> = faces.iter().map(|&v| int(v as usize)).collect();
        assert!(
            faces.iter().all(|&v| (v as usize) < positions.len()),
            "indices below the number of points"
        );
        let counts = vec![int(sides); count];
        // SAFETY: the arrays are as long as the numbers say, indices are in range, and all are only read during the call.
        let surface = unsafe {
            T::create(
                c_int::from(triangles),
                int(positions.len()),
                int(count),
                counts.as_ptr(),
                indices.as_ptr(),
                positions.as_ptr().cast(),
                int(level as usize),
            )
        };
        Self {
            surface: NonNull::new(surface).expect("OpenSubdiv takes the mesh"),
            ptex_faces: int(count),
            real: PhantomData,
        }
    }

    /// At each place (face, parameters) the position and the derivatives by u and v, and if `N` is 6 those by uu, uv
    /// and vv.
    ///
    /// # Panics
    /// If `N` is neither 3 nor 6, lengths differ, a face does not exist or a place is not on the surface.
    pub fn evaluate<const N: usize>(&self, faces: &[i32], uvs: &[[T; 2]], out: &mut [[[T; 3]; N]]) {
        assert!(N == 3 || N == 6);
        assert!(faces.len() == uvs.len() && faces.len() == out.len());
        assert!(faces.iter().all(|&f| (0..self.ptex_faces).contains(&f)));
        let count = c_int::try_from(faces.len()).expect("a number of 31 bits");
        // SAFETY: `surface` lives as long as `self`; the three arrays hold `count` places each, as asserted, and
        // a place in `out` has 18 numbers where second derivatives are asked for, else 9.
        let found = unsafe {
            T::evaluate(
                self.surface.as_ptr(),
                c_int::from(N == 6),
                count,
                faces.as_ptr(),
                uvs.as_ptr().cast(),
                out.as_mut_ptr().cast(),
            )
        };
        assert_eq!(found, count, "places that are not on the surface");
    }
}

impl<T: Real> Drop for Far<T> {
    fn drop(&mut self) {
        // SAFETY: made by `create` of the same precision, and deleted once.
        unsafe { T::delete(self.surface.as_ptr()) }
    }
}

mod sealed {
    use super::{c_int, c_void};

    /// The border's functions for one precision.
    pub trait Border: Sized {
        /// # Safety
        /// Arrays are as long as the numbers say, indices in range.
        unsafe fn create(
            triangles: c_int,
            vertices: c_int,
            faces: c_int,
            counts: *const c_int,
            indices: *const c_int,
            positions: *const f32,
            level: c_int,
        ) -> *mut c_void;
        /// # Safety
        /// `surface` is one of this precision; arrays hold `count` places, `out` 18 numbers for each if `second` is
        /// not 0, else 9.
        unsafe fn evaluate(
            surface: *const c_void,
            second: c_int,
            count: c_int,
            faces: *const c_int,
            uvs: *const Self,
            out: *mut Self,
        ) -> c_int;
        /// # Safety
        /// `surface` is one of this precision, deleted once.
        unsafe fn delete(surface: *mut c_void);
    }

    macro_rules! border {
        ($real:ty, $create:ident, $evaluate:ident, $delete:ident) => {
            unsafe extern "C" {
                fn $create(
                    triangles: c_int,
                    vertices: c_int,
                    faces: c_int,
                    counts: *const c_int,
                    indices: *const c_int,
                    positions: *const f32,
                    level: c_int,
                ) -> *mut c_void;
                fn $evaluate(
                    surface: *const c_void,
                    second: c_int,
                    count: c_int,
                    faces: *const c_int,
                    uvs: *const $real,
                    out: *mut $real,
                ) -> c_int;
                fn $delete(surface: *mut c_void);
            }

            impl Border for $real {
                // SAFETY: the trait says what the caller promises.
                unsafe fn create(
                    triangles: c_int,
                    vertices: c_int,
                    faces: c_int,
                    counts: *const c_int,
                    indices: *const c_int,
                    positions: *const f32,
                    level: c_int,
                ) -> *mut c_void {
                    // SAFETY: as the caller promises.
                    unsafe {
                        $create(
                            triangles, vertices, faces, counts, indices, positions, level,
                        )
                    }
                }
                // SAFETY: the trait says what the caller promises.
                unsafe fn evaluate(
                    surface: *const c_void,
                    second: c_int,
                    count: c_int,
                    faces: *const c_int,
                    uvs: *const Self,
                    out: *mut Self,
                ) -> c_int {
                    // SAFETY: as the caller promises.
                    unsafe { $evaluate(surface, second, count, faces, uvs, out) }
                }
                // SAFETY: the trait says what the caller promises.
                unsafe fn delete(surface: *mut c_void) {
                    // SAFETY: as the caller promises.
                    unsafe { $delete(surface) }
                }
            }
        };
    }

    border!(
        f32,
        far_border_create_f32,
        far_border_evaluate_f32,
        far_border_delete_f32
    );
    border!(
        f64,
        far_border_create_f64,
        far_border_evaluate_f64,
        far_border_delete_f64
    );
}
