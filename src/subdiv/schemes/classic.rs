//! The classical schemes beside Catmull-Clark and Loop, behind one call: a control mesh in, a finer one out.
//!
//! A scheme says what one step makes of faces and points (`Step`); what follows from that is the same for all and
//! stands here. Vertex primvars follow the points. Varying and face-varying ones are linear in the coarser faces, and
//! face-varying ones keep their seams: at a seam the new faces take their values from one side. Uniform ones go from
//! parent to child.
//!
//! None of these schemes has a rule for sharp edges inside the mesh, so creases have no effect, nor have corners, but
//! for infinitely sharp ones of √3, which stay. What has no effect is counted. Edges that more than two faces share,
//! or two that disagree which side is the front, count as borders of each of their faces.

use std::collections::HashMap;

use super::butterfly::Butterfly;
use super::doo_sabin::DooSabin;
use super::sqrt3::Sqrt3;
use crate::error::Fault;
use crate::math::{DVec3, Vec3};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Corner, Crease, Interpolation, Primvar, Scheme, Topology,
};
use crate::subdiv::stencils::Stencils;

/// Which scheme.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SchemeKind {
    /// Doo and Sabin 1978: any faces.
    DooSabin,
    /// Dyn, Levin and Gregory 1990 with the rules of Zorin, Schröder and Sweldens 1996: triangles.
    Butterfly,
    /// Kobbelt 2000: triangles. The control mesh's edges come back at even levels.
    Sqrt3,
}

/// A finer mesh, and where its faces come from.
#[derive(Debug, Clone)]
pub struct Refined {
    /// A polygon mesh ([`Scheme::None`]): all motion keys and primvars, holes. Its only tags are √3's corners.
    pub mesh: ControlMesh,
    /// The control mesh's face that each face comes from. A face that covers parts of several has the one in which
    /// it has its first corner (Doo-Sabin's faces for edges and vertices, the turned triangles of √3's odd levels).
    pub parent_face: Vec<u32>,
    /// How many creases and corners of the control mesh had no effect.
    pub ignored_tags: usize,
}

/// Each corner's point depends on all corners of its face: beyond this the weights of one face fill memory.
const MOST_CORNERS: usize = 1 << 12;

/// Refines `levels` times.
///
/// Refine to the wanted level in one call: what a step does may depend on the one before (√3 takes its borders along
/// in every second step; a hole of Doo-Sabin's keeps its size).
///
/// # Errors
/// A mesh that is not valid, a face with a point twice, with more than 4096 corners, or with other than three for a
/// scheme of triangles, a level at which the
/// corners could not be numbered with 32 bits.
pub fn refine(mesh: &ControlMesh, scheme: SchemeKind, levels: u32) -> Result<Refined, Fault> {
    check(mesh, scheme)?;
    // Before any work: how a closed mesh grows. Borders make Doo-Sabin's grow a little faster, so each step looks too.
    let growth: u64 = if scheme == SchemeKind::Sqrt3 { 3 } else { 4 };
    let largest = mesh.face_vertex_indices.len().max(1) as u64;
    let grown = growth
        .checked_pow(levels)
        .and_then(|g| g.checked_mul(largest));
    if grown.is_none_or(|corners| corners > u64::from(u32::MAX)) {
        return Err(Fault::new(format!(
            "{} subdivision to level {levels} has more corners than 32 bits can number",
            scheme.name()
        ))
        .advise("refine to a lower level"));
    }
    let mut rules: Box<dyn Rules> = match scheme {
        SchemeKind::DooSabin => Box::new(DooSabin::default()),
        SchemeKind::Butterfly => Box::new(Butterfly),
        SchemeKind::Sqrt3 => Box::new(Sqrt3::default()),
    };
    let mut corners = mesh.corners.clone();
    corners.retain(|c| scheme == SchemeKind::Sqrt3 && c.sharpness >= Crease::INFINITE);
    let mut refined = Refined {
        ignored_tags: mesh.creases.len() + mesh.corners.len() - corners.len(),
        parent_face: (0..mesh.face_count() as u32).collect(),
        mesh: ControlMesh {
            scheme: Scheme::None,
            creases: Vec::new(),
            corners,
            normals: None,
            ..mesh.clone()
        },
    };
    if mesh.boundary == BoundaryInterpolation::None && scheme.needs_triangles() {
        drop_border_faces(&mut refined.mesh);
    }
    for level in 0..levels {
        // Five times the corners is the most that a step makes; Doo-Sabin adds two for each fan at the border.
        let corners = refined.mesh.face_vertex_indices.len() as u64;
        if corners * 8 > u64::from(u32::MAX) {
            return Err(Fault::new(format!(
                "level {level} has {corners} corners: the next one cannot be numbered with 32 bits"
            ))
            .advise(format!("refine to level {level} at most")));
        }
        let topology = refined.mesh.topology();
        let step = rules.step(&refined.mesh, &topology);
        let mesh = step.apply(&refined.mesh, &topology);
        let parent = |&f: &u32| refined.parent_face[f as usize];
        refined.parent_face = step.parent_face.iter().map(parent).collect();
        drop(step);
        refined.mesh = mesh;
    }
    Ok(refined)
}

impl SchemeKind {
    /// Whether all faces must have three corners.
    pub fn needs_triangles(self) -> bool {
        self != Self::DooSabin
    }

    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::DooSabin => "Doo-Sabin",
            Self::Butterfly => "Butterfly",
            Self::Sqrt3 => "√3",
        }
    }
}

/// A scheme, and what it remembers from one step to the next.
pub(super) trait Rules {
    /// What the next step makes of `mesh`.
    fn step<'a>(&mut self, mesh: &'a ControlMesh, topology: &'a Topology) -> Step<'a>;
}

/// One step of refinement: the finer faces, and what makes everything on them.
pub(super) struct Step<'a> {
    /// Corners of each finer face.
    pub(super) counts: Vec<u32>,
    /// Points of the finer faces' corners.
    pub(super) indices: Vec<u32>,
    /// The coarser face of each finer one.
    pub(super) parent_face: Vec<u32>,
    /// Finer faces that are holes.
    pub(super) holes: Vec<u32>,
    /// Points that stay in all further steps, though their faces no longer show it.
    pub(super) kept_corners: Vec<Corner>,
    /// Finer points from coarser ones.
    pub(super) points: Stencils,
    /// The same without smoothing.
    pub(super) linear: Stencils,
    /// Finer corners from coarser corners, given which edges are seams.
    pub(super) corners: CornerRows<'a>,
}

/// Makes the rows of finer corners from the coarser mesh's seams, by edge.
pub(super) type CornerRows<'a> = Box<dyn Fn(&[bool]) -> Stencils + 'a>;

impl Step<'_> {
    fn apply(&self, mesh: &ControlMesh, topology: &Topology) -> ControlMesh {
        ControlMesh {
            face_vertex_counts: self.counts.clone(),
            face_vertex_indices: self.indices.clone(),
            points: mesh
                .points
                .iter()
                .map(|p| points(&self.points, p))
                .collect(),
            holes: self.holes.clone(),
            primvars: (mesh.primvars.iter())
                .map(|p| self.primvar(p, topology))
                .collect(),
            creases: Vec::new(),
            corners: self.kept_corners.clone(),
            normals: None,
            ..*mesh
        }
    }

    fn primvar(&self, primvar: &Primvar, topology: &Topology) -> Primvar {
        let refine = |rows: &Stencils, count: usize| {
            let elements = (0..count).flat_map(|i| primvar.get(i));
            let elements: Vec<f64> = elements.map(|&x| f64::from(x)).collect();
            let values = rows.apply(primvar.width as usize, &elements);
            values.into_iter().map(|x| x as f32).collect()
        };
        let (values, indices) = match primvar.interpolation {
            Interpolation::Constant => (primvar.values.clone(), primvar.indices.clone()),
            Interpolation::Uniform => {
                let element = |&f: &u32| primvar.indices.as_ref().map_or(f, |i| i[f as usize]);
                let indices = self.parent_face.iter().map(element).collect();
                (primvar.values.clone(), Some(indices))
            }
            Interpolation::Varying => (refine(&self.linear, topology.vertex_count()), None),
            Interpolation::Vertex => (refine(&self.points, topology.vertex_count()), None),
            Interpolation::FaceVarying => {
                let stencils = (self.corners)(&seams(primvar, topology));
                let values: Vec<f32> = refine(&stencils, topology.corner_count());
                let (values, indices) = share(&values, primvar.width as usize);
                (values, Some(indices))
            }
        };
        Primvar {
            values,
            indices,
            ..primvar.clone()
        }
    }
}

/// New points from old ones.
pub(super) fn points(rows: &Stencils, points: &[Vec3]) -> Vec<Vec3> {
    let old: Vec<f64> = points
        .iter()
        .flat_map(|p| p.as_dvec3().to_array())
        .collect();
    let new = rows.apply(3, &old);
    let point = |p: &[f64]| DVec3::from_slice(p).as_vec3();
    new.chunks_exact(3).map(point).collect()
}

/// The edges at which a face-varying primvar has two values at an end. Edges without just two faces are none: no
/// scheme looks across them.
fn seams(primvar: &Primvar, topology: &Topology) -> Vec<bool> {
    let same = |a: u32, b: u32| primvar.get(a as usize) == primvar.get(b as usize);
    (0..topology.edge_count() as u32)
        .map(|edge| match topology.edge_corners(edge) {
            &[a, b] if topology.is_edge_manifold(edge) => {
                !(same(a, topology.next(b)) && same(topology.next(a), b))
            }
            _ => false,
        })
        .collect()
}

/// Elements that are the same bits become one.
fn share(values: &[f32], width: usize) -> (Vec<f32>, Vec<u32>) {
    let mut known: HashMap<Vec<u32>, u32> = HashMap::new();
    let mut shared = Vec::new();
    let indices = values
        .chunks_exact(width)
        .map(|element| {
            let bits = element.iter().map(|x| x.to_bits()).collect();
            let next = known.len() as u32;
            *known.entry(bits).or_insert_with(|| {
                shared.extend_from_slice(element);
                next
            })
        })
        .collect();
    (shared, indices)
}

fn check(mesh: &ControlMesh, scheme: SchemeKind) -> Result<(), Fault> {
    mesh.validate()?;
    for (face, range) in mesh.faces().enumerate() {
        let corners = &mesh.face_vertex_indices[range];
        if scheme.needs_triangles() && corners.len() != 3 {
            return Err(Fault::new(format!(
                "{} subdivision of a face with {} corners",
                scheme.name(),
                corners.len()
            ))
            .at_face(face)
            .advise("triangulate the mesh, or take catmull-clark or doo-sabin"));
        }
        let mut sorted = corners.to_vec();
        sorted.sort_unstable();
        if corners.len() > MOST_CORNERS {
            return Err(Fault::new(format!("a face with {} corners", corners.len()))
                .at_face(face)
                .advise(format!(
                    "split it into faces of {MOST_CORNERS} corners at most"
                )));
        }
        if let Some(pair) = sorted.windows(2).find(|p| p[0] == p[1]) {
            return Err(Fault::new(format!("point {} is a corner twice", pair[0]))
                .at_face(face)
                .advise("split the face, or remove the repeated corner"));
        }
    }
    Ok(())
}

/// Makes holes of the faces that touch the border, which then is one like any other.
fn drop_border_faces(mesh: &mut ControlMesh) {
    let topology = mesh.topology();
    let mut at_border = vec![false; topology.vertex_count()];
    for edge in (0..topology.edge_count() as u32).filter(|&e| topology.is_border(e)) {
        for vertex in topology.edge_vertices(edge) {
            at_border[vertex as usize] = true;
        }
    }
    for face in 0..topology.face_count() as u32 {
        let vertices = topology.face_vertices(face);
        if vertices.iter().any(|&v| at_border[v as usize]) {
            mesh.holes.push(face);
        }
    }
    mesh.boundary = BoundaryInterpolation::EdgeOnly;
}

/// For each face whether it is a hole.
pub(super) fn holes(mesh: &ControlMesh) -> Vec<bool> {
    let mut hole = vec![false; mesh.face_count()];
    for &face in &mesh.holes {
        hole[face as usize] = true;
    }
    hole
}

/// The numbers at which `flags` are set.
pub(super) fn numbers(flags: impl Iterator<Item = bool>) -> Vec<u32> {
    (0..)
        .zip(flags)
        .filter_map(|(i, set)| set.then_some(i))
        .collect()
}
