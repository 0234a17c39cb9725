//! The creature's cage: a tortoise, modelled as one would by hand, from boxes and extrusions.
//!
//! 1. Cells of a lattice are filled: carapace, neck, head, tail, four legs. Their outer faces are one closed mesh of
//!    quads; where cells meet in corners its points have three, five or six faces.
//! 2. Each lattice point moves to where the animal has it ([`place`]).
//! 3. Faces are inset and pushed: scutes on the carapace, eyes with lids, a claw on each foot.
//! 4. Rings of edges become semi-sharp: the carapace's rim, lids, beak, claws.
//!
//! Each face shows one whole tile of the scales, which fit whatever way faces are turned (see `maps.rs`).

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

type Cell = [i32; 3];
type Point = [f32; 3];

/// Sharpness that still rounds off, and one that keeps an edge over three levels.
const SOFT: f32 = 1.2;
const FIRM: f32 = 2.5;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Skin,
    Shell,
    Eye,
    Claw,
}

#[derive(Default)]
struct Cage {
    points: Vec<Point>,
    faces: Vec<([usize; 4], Part)>,
    creases: Vec<([usize; 2], f32)>,
}

/// The cage as a layer of USD with one mesh.
pub(crate) fn usda() -> String {
    let (mut cage, lattice) = skin(&cells());
    crease_rim(&mut cage, &lattice);
    let plates: Vec<usize> = (0..cage.faces.len())
        .filter(|&f| cage.faces[f].1 == Part::Shell)
        .collect();
    for face in plates {
        scute(&mut cage, face);
    }
    for side in [-1, 1] {
        let eye = |y: i32, z: i32| [side, y, z];
        let face = [eye(2, 4), eye(2, 5), eye(3, 5), eye(3, 4)];
        let face = cage.find(&lattice, face);
        eye_ball(&mut cage, face);
        for z in [3, -1] {
            let toe = |x: i32, y: i32| [x * side, y, z];
            let face = cage.find(&lattice, [toe(1, -1), toe(2, -1), toe(2, 0), toe(1, 0)]);
            claw(&mut cage, face);
        }
    }
    cage.text()
}

/// The filled cells; cell (x, y, z) reaches to (x + 1, y + 1, z + 1). The animal looks along z, y is up.
fn cells() -> BTreeSet<Cell> {
    let mut cells = BTreeSet::new();
    let mut fill = |x: [i32; 2], y: [i32; 2], z: [i32; 2]| {
        for x in x[0]..x[1] {
            for y in y[0]..y[1] {
                cells.extend((z[0]..z[1]).map(|z| [x, y, z]));
            }
        }
    };
    fill([-2, 2], [1, 3], [-2, 3]);
    fill([-1, 1], [1, 3], [-3, -2]);
    fill([-1, 1], [1, 2], [3, 4]);
    fill([-1, 1], [1, 3], [4, 6]);
    fill([-1, 1], [1, 2], [-4, -3]);
    for x in [[-2, -1], [1, 2]] {
        fill(x, [-1, 1], [2, 3]);
        fill(x, [-1, 1], [-2, -1]);
    }
    cells
}

/// The outer faces of the cells, counterclockwise from outside, and the number of each lattice point.
fn skin(cells: &BTreeSet<Cell>) -> (Cage, BTreeMap<Cell, usize>) {
    let mut cage = Cage::default();
    let mut numbers = BTreeMap::new();
    for &cell in cells {
        for axis in 0..3 {
            for side in [0, 1] {
                let mut next = cell;
                next[axis] += 2 * side - 1;
                if cells.contains(&next) {
                    continue;
                }
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut around = [[0, 0], [1, 0], [1, 1], [0, 1]];
                if side == 0 {
                    around.reverse();
                }
                let corners = around.map(|[a, b]| {
                    let mut corner = cell;
                    corner[axis] += side;
                    corner[u] += a;
                    corner[v] += b;
                    *numbers.entry(corner).or_insert_with(|| {
                        cage.points.push(place(corner));
                        cage.points.len() - 1
                    })
                });
                let body = (-3..=2).contains(&cell[2]) && cell[1] == 2;
                let part = if body { Part::Shell } else { Part::Skin };
                cage.faces.push((corners, part));
            }
        }
    }
    (cage, numbers)
}

/// Where a lattice point lies on the animal.
fn place([x, y, z]: Cell) -> Point {
    let (fx, fz) = (x as f32, z as f32);
    let side = fx.signum();
    match (y, z) {
        // Legs: knees, then feet, which reach forward.
        (-1 | 0, _) => {
            let front = z > 0;
            let (outer, inner) = (x.abs() == 2, if front { 2.5 } else { -1.5 });
            let foot = y == -1;
            let half = if foot { 0.44 } else { 0.38 };
            let middle = [
                if foot { 1.95 } else { 1.75 },
                if front { 1.75 } else { -1.75 } + if foot { 0.12 } else { 0.0 },
            ];
            let across = if outer { half } else { -half };
            let height = if foot { -0.95 } else { -0.2 };
            [
                side * (middle[0] + across),
                height,
                middle[1] + 2.0 * half * (fz - inner),
            ]
        }
        // The head, from the neck on: up, along, and its width.
        (_, 4..) => {
            let (height, length, width) = match (y, z) {
                (1, 4) => (0.75, 3.75, 0.34),
                (2, 4) => (1.15, 3.65, 0.36),
                (_, 4) => (1.72, 3.85, 0.40),
                (1, 5) => (0.88, 4.45, 0.46),
                (2, 5) => (1.22, 4.50, 0.55),
                (_, 5) => (1.80, 4.50, 0.44),
                (1, _) => (0.98, 5.00, 0.26),
                (2, _) => (1.14, 5.18, 0.28),
                _ => (1.52, 4.98, 0.28),
            };
            let beak = if z == 6 && x == 0 { 0.16 } else { 0.0 };
            [width * fx, height, length + beak]
        }
        // The tip of the tail.
        (_, -4) => [0.12 * fx, 0.1 + 0.14 * (y - 1) as f32, -3.75],
        // The body: a square made round, a flat belly, a wide rim, a dome.
        _ => {
            let (u, w) = (fx / 2.0, (fz / 3.0).clamp(-1.0, 1.0));
            let round = [
                u * (1.0 - w * w / 2.0).sqrt(),
                w * (1.0 - u * u / 2.0).sqrt(),
            ];
            let far = round[0].hypot(round[1]).min(1.0);
            let (width, length, height) = match y {
                1 => (1.95, 2.75, 0.35),
                2 => (2.55, 3.25, 0.62),
                _ => (
                    2.15,
                    2.75,
                    0.9 + 1.9 * (1.0 - 0.86 * far * far).max(0.0).sqrt(),
                ),
            };
            [width * round[0], height, length * round[1]]
        }
    }
}

/// The rim of the carapace, and the line of the beak.
fn crease_rim(cage: &mut Cage, lattice: &BTreeMap<Cell, usize>) {
    let place: BTreeMap<usize, Cell> = lattice.iter().map(|(&cell, &i)| (i, cell)).collect();
    let mut rim = BTreeSet::new();
    let mut beak = BTreeSet::new();
    for (corners, _) in &cage.faces {
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let [p, q] = [place[&a], place[&b]];
            let edge = [a.min(b), a.max(b)];
            let level = p[1] == 2 && q[1] == 2;
            if level && p[2].max(q[2]) <= 3 && p[2].min(q[2]) >= -3 {
                rim.insert(edge);
            }
            if level && p[2].min(q[2]) >= 5 {
                beak.insert(edge);
            }
        }
    }
    cage.creases.extend(rim.into_iter().map(|e| (e, FIRM)));
    cage.creases.extend(beak.into_iter().map(|e| (e, FIRM)));
}

/// A raised plate with a soft edge and a groove around it.
fn scute(cage: &mut Cage, face: usize) {
    cage.inset(face, 0.16, -0.05, Part::Shell);
    let ring = cage.inset(face, 0.16, 0.14, Part::Shell);
    cage.crease(ring, SOFT);
    cage.inset(face, 0.5, 0.05, Part::Shell);
}

/// A lid around a ball.
fn eye_ball(cage: &mut Cage, face: usize) {
    let lid = cage.inset(face, 0.30, 0.09, Part::Skin);
    cage.crease(lid, FIRM);
    let socket = cage.inset(face, 0.28, -0.06, Part::Skin);
    cage.crease(socket, SOFT);
    cage.inset(face, 0.12, 0.06, Part::Eye);
    cage.faces[face].1 = Part::Eye;
}

/// A blunt claw that grows out of a face.
fn claw(cage: &mut Cage, face: usize) {
    let root = cage.inset(face, 0.25, 0.02, Part::Skin);
    cage.crease(root, SOFT);
    let tip = cage.inset(face, 0.55, 0.30, Part::Claw);
    cage.crease(tip, FIRM);
    cage.faces[face].1 = Part::Claw;
}

impl Cage {
    /// The face with these lattice points, in any order.
    fn find(&self, lattice: &BTreeMap<Cell, usize>, corners: [Cell; 4]) -> usize {
        let wanted: BTreeSet<usize> = corners.iter().map(|c| lattice[c]).collect();
        let is_wanted = |(face, _): &([usize; 4], Part)| face.iter().all(|p| wanted.contains(p));
        let found = self.faces.iter().position(is_wanted);
        found.expect("the face is on the skin")
    }

    /// Shrinks a face by `share` towards its middle, moves it by `push` along its normal, and closes the gap with
    /// four faces of the kind `part`. The ring of the shrunk face's points.
    fn inset(&mut self, face: usize, share: f32, push: f32, part: Part) -> [usize; 4] {
        let (old, _) = self.faces[face];
        let p = old.map(|i| self.points[i]);
        let axis = |k: usize| [p[0], p[1], p[2], p[3]].iter().map(|q| q[k]).sum::<f32>() / 4.0;
        let middle = [axis(0), axis(1), axis(2)];
        let [d, e] = [[0, 2], [1, 3]].map(|[a, b]| [0, 1, 2].map(|k| p[b][k] - p[a][k]));
        let cross = [0, 1, 2].map(|k| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            d[i] * e[j] - d[j] * e[i]
        });
        let length = cross.iter().map(|x| x * x).sum::<f32>().sqrt();
        let first = self.points.len();
        for q in p {
            let moved = [0, 1, 2]
                .map(|k| q[k] + share * (middle[k] - q[k]) + push * cross[k] / length.max(1e-9));
            self.points.push(moved);
        }
        let new = [0, 1, 2, 3].map(|i| first + i);
        for i in 0..4 {
            let j = (i + 1) % 4;
            self.faces.push(([old[i], old[j], new[j], new[i]], part));
        }
        self.faces[face].0 = new;
        new
    }

    fn crease(&mut self, ring: [usize; 4], sharpness: f32) {
        let edges = (0..4).map(|i| ([ring[i], ring[(i + 1) % 4]], sharpness));
        self.creases.extend(edges);
    }

    fn text(&self) -> String {
        let mut text = String::from(
            "#usda 1.0\n(\n    defaultPrim = \"Tortoise\"\n    doc = \"Written by examples/make_scenes\"\n    \
             metersPerUnit = 0.1\n    upAxis = \"Y\"\n)\n\ndef Mesh \"Tortoise\"\n{\n    \
             uniform token subdivisionScheme = \"catmullClark\"\n    \
             uniform token faceVaryingLinearInterpolation = \"all\"\n",
        );
        let mut list = |name: &str, values: &mut dyn Iterator<Item = String>| {
            let values: Vec<String> = values.collect();
            let rows: Vec<String> = values.chunks(12).map(|row| row.join(", ")).collect();
            let rows = rows.join(",\n        ");
            writeln!(text, "    {name} = [\n        {rows}\n    ]").expect("a string takes all");
        };
        let faces = || self.faces.iter().map(|f| f.0);
        list("int[] faceVertexCounts", &mut faces().map(|_| "4".into()));
        let indices = faces().flatten();
        list(
            "int[] faceVertexIndices",
            &mut indices.map(|i| i.to_string()),
        );
        let points = self.points.iter();
        list(
            "point3f[] points",
            &mut points.map(|[x, y, z]| format!("({x:.4}, {y:.4}, {z:.4})")),
        );
        let ends = self.creases.iter().flat_map(|c| c.0);
        list("int[] creaseIndices", &mut ends.map(|i| i.to_string()));
        list(
            "int[] creaseLengths",
            &mut self.creases.iter().map(|_| "2".into()),
        );
        list(
            "float[] creaseSharpnesses",
            &mut self.creases.iter().map(|c| c.1.to_string()),
        );
        text.push_str(
            "    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (\n        \
             interpolation = \"faceVarying\"\n    )\n",
        );
        let corner = |i: usize| (i % 4).to_string();
        let corners: Vec<String> = (0..4 * self.faces.len()).map(corner).collect();
        writeln!(
            text,
            "    int[] primvars:st:indices = [{}]",
            corners.join(", ")
        )
        .expect("a string takes all");
        for (name, part) in [
            ("Shell", Part::Shell),
            ("Eyes", Part::Eye),
            ("Claws", Part::Claw),
        ] {
            let numbers = (0..self.faces.len()).filter(|&f| self.faces[f].1 == part);
            let numbers: Vec<String> = numbers.map(|f| f.to_string()).collect();
            write!(
                text,
                "\n    def GeomSubset \"{name}\"\n    {{\n        uniform token elementType = \"face\"\n        \
                 uniform token familyName = \"materialBind\"\n        int[] indices = [{}]\n    }}\n",
                numbers.join(", ")
            )
            .expect("a string takes all");
        }
        text.push_str("}\n");
        text
    }
}
