//! Dense meshes and cages whose displacement is known.

use std::collections::HashMap;
use std::fmt::Write;

use relievo::math::DVec3;

/// Points and faces, counterclockwise from outside.
#[derive(Clone)]
pub struct Model {
    pub points: Vec<DVec3>,
    pub faces: Vec<Vec<usize>>,
}

impl Model {
    /// As an OBJ file.
    pub fn obj(&self) -> String {
        let mut text = String::with_capacity(40 * (self.points.len() + self.faces.len()));
        for p in &self.points {
            let p = p.as_vec3();
            writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect("a string takes all");
        }
        for face in &self.faces {
            text.push('f');
            for corner in face {
                write!(text, " {}", corner + 1).expect("a string takes all");
            }
            text.push('\n');
        }
        text
    }

    /// As an OBJ file with texture coordinates: each face is an island in a square of its own, `margin` of that away from
    /// the next one.
    pub fn obj_with_islands(&self, margin: f64) -> String {
        let side = (self.faces.len() as f64).sqrt().ceil();
        let mut text = String::new();
        for p in &self.points {
            writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect("a string takes all");
        }
        let mut count = 0;
        for (number, face) in self.faces.iter().enumerate() {
            let (x, y) = (number as f64 % side, (number as f64 / side).floor());
            let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
            for [s, t] in &square[..face.len()] {
                let place = |at: f64, s: f64| (at + margin + s * (1.0 - 2.0 * margin)) / side;
                writeln!(text, "vt {} {}", place(x, *s), place(y, *t)).expect("a string takes all");
            }
            text.push('f');
            for corner in face {
                count += 1;
                write!(text, " {}/{count}", corner + 1).expect("a string takes all");
            }
            text.push('\n');
        }
        text
    }

    /// As a mesh of USD with these attributes beside its faces and points.
    pub fn usda(&self, attributes: &str) -> String {
        let mut text =
            "def Mesh \"Model\" (prepend apiSchemas = [\"MaterialBindingAPI\"]) {\n".to_owned();
        let mut list = |name: &str, items: &mut dyn Iterator<Item = String>| {
            write!(text, "    {name} = [").expect("a string takes all");
            for item in items {
                text.push_str(&item);
                text.push(',');
            }
            text.push_str("]\n");
        };
        let counts = self.faces.iter().map(|face| face.len().to_string());
        list("int[] faceVertexCounts", &mut { counts });
        let corners = self.faces.iter().flatten().map(usize::to_string);
        list("int[] faceVertexIndices", &mut { corners });
        let points = self.points.iter().map(|p| p.as_vec3());
        let points = points.map(|p| format!("({},{},{})", p.x, p.y, p.z));
        list("point3f[] points", &mut { points });
        text + attributes + "\n}\n"
    }

    /// Its points moved.
    pub fn moved(&self, to: impl Fn(DVec3) -> DVec3) -> Self {
        Self {
            points: self.points.iter().map(|p| to(*p)).collect(),
            faces: self.faces.clone(),
        }
    }

    /// Its faces the other way round.
    pub fn turned(&self) -> Self {
        let turn = |face: &Vec<usize>| face.iter().rev().copied().collect();
        Self {
            points: self.points.clone(),
            faces: self.faces.iter().map(turn).collect(),
        }
    }

    /// Without the faces whose middle is somewhere.
    pub fn without(&self, there: impl Fn(DVec3) -> bool) -> Self {
        let middle = |face: &[usize]| {
            let sum: DVec3 = face.iter().map(|&v| self.points[v]).sum();
            sum / face.len() as f64
        };
        let faces = self.faces.iter().filter(|face| !there(middle(face)));
        Self {
            points: self.points.clone(),
            faces: faces.cloned().collect(),
        }
    }
}

/// The unit sphere as a cube's sides of `n` x `n` quads each.
pub fn cube_sphere(n: i32) -> Model {
    let mut numbers = HashMap::new();
    let mut points = Vec::new();
    let mut faces = Vec::new();
    let mut number = |place: [i32; 3]| {
        *numbers.entry(place).or_insert_with(|| {
            let angle = |x: i32| (f64::from(x) / f64::from(n) * std::f64::consts::FRAC_PI_4).tan();
            points.push(DVec3::from(place.map(angle)).normalize());
            points.len() - 1
        })
    };
    let sides = [
        ([0, 1, 2], 1),
        ([0, 2, 1], -1),
        ([1, 2, 0], 1),
        ([1, 0, 2], -1),
        ([2, 0, 1], 1),
        ([2, 1, 0], -1),
    ];
    for ([u, v, w], sign) in sides {
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]| {
                let mut place = [0; 3];
                (place[u], place[v], place[w]) = (2 * (i + a) - n, 2 * (j + b) - n, sign * n);
                number(place)
            });
            faces.push(corners.to_vec());
        }
    }
    Model { points, faces }
}

/// The unit sphere as an octahedron whose sides are `2^levels` triangles along each edge.
pub fn octahedron_sphere(levels: u32) -> Model {
    let mut points: Vec<DVec3> = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .flat_map(|p| [p, -p])
        .collect();
    let mut faces: Vec<Vec<usize>> = Vec::new();
    for (x, y, z) in (0..8).map(|i| (i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2))) {
        let outward = (x + y + z) % 2 == 0;
        faces.push(if outward {
            vec![x, y, z]
        } else {
            vec![x, z, y]
        });
    }
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut finer = Vec::new();
        for face in &faces {
            let &[a, b, c] = &face[..] else {
                unreachable!("faces are triangles");
            };
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b)| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    points.push((points[a] + points[b]).normalize());
                    points.len() - 1
                })
            });
            finer.extend([
                vec![a, ab, ca],
                vec![ab, b, bc],
                vec![ca, bc, c],
                vec![ab, bc, ca],
            ]);
        }
        faces = finer;
    }
    Model { points, faces }
}

/// How far bumps lift the unit sphere in a direction.
pub fn bump(d: DVec3) -> f64 {
    let wave = |f: f64, p: f64| {
        (f * d.x + p).sin() * ((f - 1.0) * d.y + 2.0 * p).sin() * ((f - 2.0) * d.z).cos()
    };
    0.05 * wave(9.0, 1.0) + 0.012 * wave(30.0, 0.4)
}

/// A point of the unit sphere lifted.
pub fn lifted(p: DVec3) -> DVec3 {
    let d = p.normalize();
    d * (1.0 + bump(d))
}

/// How far a point is from the sphere with bumps, about: bumps are shallow.
pub fn off(p: DVec3) -> f64 {
    (p.length() - 1.0 - bump(p.normalize())).abs()
}
