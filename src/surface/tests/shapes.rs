//! Surfaces of bicubic patches for tests, with edges and vertices in all orientations.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::image::{
    Channel, ChannelFormat, ColorSpace, Compression, ImageSource, Part, Picture, Texture, Wrap,
    write_exr,
};
use crate::math::{Bounds3, Vec2, Vec3};
use crate::surface::{Base, Bicubic, EdgeUse, LimitGrid, LimitPoint, Texcoord, UvRect};

/// Patches that meet at whole edges.
#[derive(Clone, Default)]
pub(crate) struct Patches {
    /// By motion key and face.
    pub(crate) control: Vec<Vec<Bicubic>>,
    pub(crate) vertices: Vec<[u32; 4]>,
    pub(crate) edges: Vec<[EdgeUse; 4]>,
    pub(crate) holes: Vec<u32>,
    pub(crate) left_handed: bool,
    /// Texture coordinates of the corners, bilinear between.
    pub(crate) st: Option<Vec<[Vec2; 4]>>,
    /// Whether the control points are kept to itself.
    pub(crate) opaque: bool,
    /// Edges that are but a point.
    pub(crate) collapsed: Vec<(u32, u32)>,
}

impl Patches {
    pub(crate) fn new(vertices: Vec<[u32; 4]>, control: Vec<Bicubic>) -> Self {
        let mut numbers = BTreeMap::new();
        let edges = vertices
            .iter()
            .map(|corners| {
                [0, 1, 2, 3].map(|k| {
                    let (a, b) = (corners[k], corners[(k + 1) % 4]);
                    let next = numbers.len() as u32;
                    let edge = *numbers.entry((a.min(b), a.max(b))).or_insert(next);
                    EdgeUse {
                        edge,
                        reversed: a > b,
                    }
                })
            })
            .collect();
        Self {
            control: vec![control],
            vertices,
            edges,
            ..Self::default()
        }
    }

    /// Nothing.
    pub(crate) fn empty() -> Self {
        Self::new(Vec::new(), Vec::new())
    }

    /// Flat and bent quads.
    pub(crate) fn bilinear(points: &[Vec3], quads: Vec<[u32; 4]>) -> Self {
        let control = quads
            .iter()
            .map(|quad| {
                let [a, b, c, d] = quad.map(|v| points[v as usize]);
                Bicubic(std::array::from_fn(|i| {
                    let (u, v) = ((i % 4) as f32 / 3.0, (i / 4) as f32 / 3.0);
                    a.lerp(b, u).lerp(d.lerp(c, u), v)
                }))
            })
            .collect();
        Self::new(quads, control)
    }

    /// A cube from -1 to 1, all of whose edges are creases.
    pub(crate) fn cube() -> Self {
        let points: Vec<Vec3> = (0..8)
            .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - 1.0)
            .collect();
        let mut cube = Self::bilinear(
            &points,
            vec![
                [4, 5, 7, 6],
                [0, 2, 3, 1],
                [0, 1, 5, 4],
                [2, 6, 7, 3],
                [1, 3, 7, 5],
                [0, 4, 6, 2],
            ],
        );
        cube.st = Some(vec![[Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]; 6]);
        cube
    }

    /// Close to a unit sphere: six times n by n patches through points of it, with a texture seam around each six.
    pub(crate) fn sphere(n: i32) -> Self {
        let mut numbers = BTreeMap::new();
        let (mut vertices, mut control, mut st) = (Vec::new(), Vec::new(), Vec::new());
        for side in 0..6 {
            let axis = side / 2;
            let place = |x: f32, y: f32| {
                let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
                let mut p = [0.0; 3];
                p[axis] = sign;
                p[(axis + 1) % 3] = x * sign;
                p[(axis + 2) % 3] = y;
                Vec3::from(p)
            };
            for j in 0..n {
                for i in 0..n {
                    let at = |u: f32, v: f32| {
                        let on = |x: f32| 2.0 * x / n as f32 - 1.0;
                        place(on(i as f32 + u), on(j as f32 + v))
                    };
                    let corners = [(0, 0), (1, 0), (1, 1), (0, 1)];
                    vertices.push(corners.map(|(u, v)| {
                        let key = (at(u as f32, v as f32) * n as f32).round().as_ivec3();
                        let next = numbers.len() as u32;
                        *numbers.entry(key.to_array()).or_insert(next)
                    }));
                    control.push(through(|u, v| at(u, v).normalize()));
                    st.push(
                        corners.map(|(u, v)| Vec2::new((i + u) as f32, (j + v) as f32) / n as f32),
                    );
                }
            }
        }
        Self {
            st: Some(st),
            ..Self::new(vertices, control)
        }
    }

    /// Close to a torus of radii 1 and 0.4, n by m patches, one image around it.
    pub(crate) fn torus(n: u32, m: u32) -> Self {
        let (mut vertices, mut control, mut st) = (Vec::new(), Vec::new(), Vec::new());
        for j in 0..m {
            for i in 0..n {
                let corners = [(0, 0), (1, 0), (1, 1), (0, 1)];
                vertices.push(corners.map(|(u, v)| (i + u) % n + (j + v) % m * n));
                control.push(through(|u, v| {
                    let turn = |x: f32, n: u32| (x / n as f32 * std::f32::consts::TAU).sin_cos();
                    let (s, c) = turn(i as f32 + u, n);
                    let (t, d) = turn(j as f32 + v, m);
                    Vec3::new((1.0 + 0.4 * d) * c, (1.0 + 0.4 * d) * s, 0.4 * t)
                }));
                st.push(
                    corners.map(|(u, v)| {
                        Vec2::new((i + u) as f32 / n as f32, (j + v) as f32 / m as f32)
                    }),
                );
            }
        }
        Self {
            st: Some(st),
            ..Self::new(vertices, control)
        }
    }

    /// A sphere of two patches' height whose poles are collapsed edges, `n` patches around.
    pub(crate) fn globe(n: u32) -> Self {
        let (mut vertices, mut control, mut collapsed) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..n {
            for south in [true, false] {
                let (a, b) = (i, (i + 1) % n);
                let (pole_south, pole_north) = (n, n + 1);
                collapsed.push((control.len() as u32, if south { 0 } else { 2 }));
                vertices.push(if south {
                    [pole_south, pole_south, b, a]
                } else {
                    [a, b, pole_north, pole_north]
                });
                control.push(through(|u, v| {
                    let angle = (i as f32 + u) / n as f32 * std::f32::consts::TAU;
                    let height = (v - if south { 1.0 } else { 0.0 }) * std::f32::consts::FRAC_PI_2;
                    let (s, c) = angle.sin_cos();
                    let (z, r) = height.sin_cos();
                    if z.abs() == 1.0 {
                        Vec3::Z * z
                    } else {
                        Vec3::new(r * c, r * s, z)
                    }
                }));
            }
        }
        Self {
            collapsed,
            ..Self::new(vertices, control)
        }
    }

    /// The same surface with the faces' parameters turned by pseudo-random quarters.
    pub(crate) fn turned(self) -> Self {
        let mut turned = Self {
            vertices: self.vertices.clone(),
            control: self.control.clone(),
            st: self.st.clone(),
            ..Self::default()
        };
        for face in 0..turned.vertices.len() {
            let quarters = face * 7 % 11 % 4;
            turned.vertices[face].rotate_left(quarters);
            if let Some(st) = &mut turned.st {
                st[face].rotate_left(quarters);
            }
            for patches in &mut turned.control {
                for _ in 0..quarters {
                    let old = patches[face].0;
                    patches[face].0 = std::array::from_fn(|i| old[4 * (i % 4) + 3 - i / 4]);
                }
            }
        }
        let Self {
            vertices,
            mut control,
            st,
            ..
        } = turned;
        let keys = control.split_off(1);
        let mut turned = Self::new(vertices, control.remove(0));
        turned.control.extend(keys);
        Self {
            st,
            holes: self.holes,
            left_handed: self.left_handed,
            ..turned
        }
    }

    /// With all control points mapped, at all keys.
    pub(crate) fn mapped(mut self, map: impl Fn(Vec3) -> Vec3) -> Self {
        for patch in self.control.iter_mut().flatten() {
            patch.0 = patch.0.map(&map);
        }
        self
    }

    /// With one more motion key, whose control points are those of the first key mapped.
    pub(crate) fn moving(mut self, map: impl Fn(Vec3) -> Vec3) -> Self {
        let moved = self.control[0].iter().map(|p| Bicubic(p.0.map(&map)));
        self.control.push(moved.collect());
        self
    }

    fn patch(&self, face: u32, key: u32) -> &Bicubic {
        &self.control[key as usize][face as usize]
    }
}

/// The patch through a surface's points at thirds of the unit square.
fn through(point: impl Fn(f32, f32) -> Vec3) -> Bicubic {
    let bezier = |p: [Vec3; 4]| {
        [
            p[0],
            (-5.0 * p[0] + 18.0 * p[1] - 9.0 * p[2] + 2.0 * p[3]) / 6.0,
            (2.0 * p[0] - 9.0 * p[1] + 18.0 * p[2] - 5.0 * p[3]) / 6.0,
            p[3],
        ]
    };
    let rows: [[Vec3; 4]; 4] = std::array::from_fn(|r| {
        bezier(std::array::from_fn(|c| {
            point(c as f32 / 3.0, r as f32 / 3.0)
        }))
    });
    let columns: [[Vec3; 4]; 4] =
        std::array::from_fn(|c| bezier(std::array::from_fn(|r| rows[r][c])));
    Bicubic(std::array::from_fn(|i| columns[i % 4][i / 4]))
}

impl Base for Patches {
    fn faces(&self) -> u32 {
        self.vertices.len() as u32
    }
    fn keys(&self) -> u32 {
        self.control.len() as u32
    }
    fn is_hole(&self, face: u32) -> bool {
        self.holes.contains(&face)
    }
    fn left_handed(&self) -> bool {
        self.left_handed
    }
    fn edge(&self, face: u32, k: u32) -> EdgeUse {
        self.edges[face as usize][k as usize]
    }
    fn vertex(&self, face: u32, k: u32) -> u32 {
        self.vertices[face as usize][k as usize]
    }
    fn is_collapsed(&self, face: u32, k: u32) -> bool {
        self.collapsed.contains(&(face, k))
    }
    fn evaluate(&self, face: u32, uv: Vec2, key: u32) -> LimitPoint {
        self.patch(face, key).evaluate(uv)
    }
    fn evaluate_grid(&self, face: u32, us: &[f32], vs: &[f32], key: u32, out: &mut LimitGrid) {
        self.patch(face, key).grid::<true>(us, vs, out);
    }
    fn hull(&self, face: u32, rect: &UvRect, key: u32) -> Bounds3 {
        self.patch(face, key).hull(rect)
    }
    fn bezier(&self, face: u32, rect: &UvRect, key: u32) -> Option<Bicubic> {
        (!self.opaque).then(|| self.patch(face, key).restricted(rect))
    }
    fn texcoord(&self, face: u32, uv: Vec2) -> Option<Texcoord> {
        let [a, b, c, d] = self.st.as_ref()?[face as usize];
        Some(Texcoord {
            st: a.lerp(b, uv.x).lerp(d.lerp(c, uv.x), uv.y),
            du: (b - a).lerp(c - d, uv.y),
            dv: (d - a).lerp(c - b, uv.x),
            duv: c - b - d + a,
            ..Texcoord::default()
        })
    }
    fn texcoord_hull(&self, face: u32, rect: &UvRect) -> Option<UvRect> {
        let corners = [
            rect.min,
            rect.max,
            Vec2::new(rect.min.x, rect.max.y),
            Vec2::new(rect.max.x, rect.min.y),
        ];
        let mut hull = UvRect {
            min: Vec2::INFINITY,
            max: Vec2::NEG_INFINITY,
        };
        for uv in corners {
            let st = self.texcoord(face, uv)?.st;
            hull = UvRect {
                min: hull.min.min(st),
                max: hull.max.max(st),
            };
        }
        let slack = 4.0 * f32::EPSILON * hull.min.abs().max(hull.max.abs());
        Some(UvRect {
            min: hull.min - slack,
            max: hull.max + slack,
        })
    }
    fn memory(&self) -> usize {
        self.control
            .iter()
            .map(|key| size_of_val(key.as_slice()))
            .sum()
    }
}

/// Numbers in 0..1 that are the same in each run.
#[derive(Clone)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f32 {
        // SplitMix64 (Steele, Lea, Flood 2014).
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    }

    pub(crate) fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0;
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    pub(crate) fn uv(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }

    pub(crate) fn rect(&mut self) -> UvRect {
        let (a, b) = (self.uv(), self.uv());
        UvRect {
            min: a.min(b),
            max: a.max(b),
        }
    }
}

/// An image of noise in -1..1.
pub(crate) fn noise(size: [u32; 2], names: &str, wrap: Wrap, seed: u64) -> Arc<Texture> {
    let mut random = Random(seed);
    let count = size[0] as usize * size[1] as usize * names.len();
    let pixels: Vec<f32> = (0..count).map(|_| 2.0 * random.next() - 1.0).collect();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("noise.exr");
    let picture = Picture {
        width: size[0],
        height: size[1],
        display_window: (size[0], size[1], 0, 0),
        parts: vec![Part {
            name: String::new(),
            channels: names
                .chars()
                .map(|name| Channel {
                    name: name.into(),
                    format: ChannelFormat::Float,
                })
                .collect(),
            pixels,
        }],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zip,
    };
    write_exr(&path, &picture).expect("written");
    let source = ImageSource::File(path);
    Arc::new(Texture::load(&source, [wrap; 2], ColorSpace::Raw).expect("loaded"))
}
