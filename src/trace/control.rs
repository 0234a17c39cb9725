//! A control mesh in Embree's buffers: topology, creases, rates and primvars, and what Embree cannot hold.
#![allow(unsafe_code)]

use std::collections::HashMap;

use embree4_sys as sys;

use super::geometry::Handle;
use super::subdivision::Rates;
use crate::error::{Fault, Result};
use crate::mesh::{
    BoundaryInterpolation, ControlMesh, Crease, FaceVaryingInterpolation, Interpolation, Primvar,
    Scheme,
};

/// Corners of a face that Embree can interpolate over: fewer than its MAX_PATCH_VALENCE of 16.
const MAX_CORNERS: u32 = 15;
/// Faces around a point (its MAX_RING_FACE_VALENCE), less one for the border.
const MAX_FACES_AROUND: u32 = 63;
/// Points around a point (its MAX_RING_EDGE_VALENCE), less two for the border.
const MAX_POINTS_AROUND: u32 = 126;

/// Where the values of a primvar come from.
pub(super) enum Slot {
    /// Constant or uniform: read off the mesh's primvar of this index.
    Plain(usize),
    /// Embree's vertex attribute of this number, with so many components.
    Attribute(u32, usize),
}

pub(crate) fn check_limits(mesh: &ControlMesh) -> Result<(), Fault> {
    if matches!(mesh.scheme, Scheme::Loop | Scheme::None) {
        return Err(Fault::new(format!(
            "Embree does not subdivide by scheme {:?}",
            mesh.scheme
        ))
        .advise("trace the refined triangles"));
    }
    if let Some(face) = mesh
        .face_vertex_counts
        .iter()
        .position(|&n| n > MAX_CORNERS)
    {
        let n = mesh.face_vertex_counts[face];
        return Err(Fault::new(format!(
            "{n} corners, where Embree subdivides at most {MAX_CORNERS}"
        ))
        .at_face(face)
        .advise("split the face, or use an intersection method other than Embree's own"));
    }
    // Faces and points around each point; a closed ring of faces has the sum of (corners - 2) points.
    let mut around = vec![[0_u32; 2]; mesh.point_count()];
    for (face, range) in mesh.faces().enumerate() {
        let corners = &mesh.face_vertex_indices[range];
        if corners.len() != 4
            && let Some(v) = repeated(corners)
        {
            return Err(Fault::new(format!(
                "{} corners, with point {v} more than once among them, which Embree subdivides in quads only",
                corners.len()
            ))
            .at_face(face)
            .advise("remove the repeated corner, or use an intersection method other than Embree's own"));
        }
        for &v in corners {
            let [faces, points] = &mut around[v as usize];
            *faces += 1;
            *points += corners.len() as u32 - 2;
            if *faces > MAX_FACES_AROUND || *points > MAX_POINTS_AROUND {
                return Err(Fault::new(format!(
                    "point {v} has more neighbours than Embree subdivides ({MAX_FACES_AROUND} faces, \
                     {MAX_POINTS_AROUND} points)"
                ))
                .at_face(face)
                .advise("divide the fan around it, or use an intersection method other than Embree's own"));
            }
        }
    }
    Ok(())
}

/// A point that occurs twice. The rings of such a face may never close: Embree then ends the process.
fn repeated(corners: &[u32]) -> Option<u32> {
    let mut with_before = corners.iter().enumerate();
    with_before.find_map(|(i, v)| corners[..i].contains(v).then_some(*v))
}

pub(super) fn build_topology(handle: &Handle, mesh: &ControlMesh) -> Result<()> {
    let uint = sys::RTC_FORMAT_UINT;
    let float = sys::RTC_FORMAT_FLOAT;
    handle.set_keys(mesh.points.len());
    handle.fill(
        sys::RTC_BUFFER_TYPE_FACE,
        0,
        uint,
        1,
        &mesh.face_vertex_counts,
    )?;
    handle.fill(
        sys::RTC_BUFFER_TYPE_INDEX,
        0,
        uint,
        1,
        &mesh.face_vertex_indices,
    )?;
    handle.fill_points(&mesh.points)?;
    let weight = |s: f32| {
        if s >= Crease::INFINITE {
            f32::INFINITY
        } else {
            s
        }
    };
    if !mesh.creases.is_empty() {
        let edges: Vec<u32> = mesh.creases.iter().flat_map(|c| c.vertices).collect();
        let weights: Vec<f32> = mesh.creases.iter().map(|c| weight(c.sharpness)).collect();
        handle.fill(
            sys::RTC_BUFFER_TYPE_EDGE_CREASE_INDEX,
            0,
            sys::RTC_FORMAT_UINT2,
            2,
            &edges,
        )?;
        handle.fill(
            sys::RTC_BUFFER_TYPE_EDGE_CREASE_WEIGHT,
            0,
            float,
            1,
            &weights,
        )?;
    }
    if !mesh.corners.is_empty() {
        let points: Vec<u32> = mesh.corners.iter().map(|c| c.vertex).collect();
        let weights: Vec<f32> = mesh.corners.iter().map(|c| weight(c.sharpness)).collect();
        handle.fill(
            sys::RTC_BUFFER_TYPE_VERTEX_CREASE_INDEX,
            0,
            uint,
            1,
            &points,
        )?;
        handle.fill(
            sys::RTC_BUFFER_TYPE_VERTEX_CREASE_WEIGHT,
            0,
            float,
            1,
            &weights,
        )?;
    }
    if !mesh.holes.is_empty() {
        handle.fill(sys::RTC_BUFFER_TYPE_HOLE, 0, uint, 1, &mesh.holes)?;
    }
    let mode = match (mesh.scheme, mesh.boundary) {
        (Scheme::Bilinear, _) => sys::RTC_SUBDIVISION_MODE_PIN_ALL,
        (_, BoundaryInterpolation::None) => sys::RTC_SUBDIVISION_MODE_NO_BOUNDARY,
        (_, BoundaryInterpolation::EdgeOnly) => sys::RTC_SUBDIVISION_MODE_SMOOTH_BOUNDARY,
        (_, BoundaryInterpolation::EdgeAndCorner) => sys::RTC_SUBDIVISION_MODE_PIN_CORNERS,
    };
    // SAFETY: the geometry is alive and a subdivision surface.
    unsafe { sys::rtcSetGeometrySubdivisionMode(handle.raw(), 0, mode) };
    handle.device.check()
}

pub(super) fn set_rates(handle: &Handle, mesh: &ControlMesh, rates: &Rates) -> Result<()> {
    // 4096 is Embree's own limit.
    let sane = |r: f32| {
        if r.is_nan() {
            1.0
        } else {
            r.clamp(1.0, 4096.0)
        }
    };
    match rates {
        Rates::Uniform(rate) => {
            // SAFETY: the geometry is alive and a subdivision surface.
            unsafe { sys::rtcSetGeometryTessellationRate(handle.raw(), sane(*rate)) };
            handle.device.check()
        }
        Rates::PerCorner(rates) => {
            let (given, needed) = (rates.len(), mesh.face_vertex_indices.len());
            if given != needed {
                return Err(Fault::new(format!("{given} rates for {needed} corners")).into());
            }
            let rates: Vec<f32> = rates.iter().map(|&r| sane(r)).collect();
            handle.fill(
                sys::RTC_BUFFER_TYPE_LEVEL,
                0,
                sys::RTC_FORMAT_FLOAT,
                1,
                &rates,
            )
        }
    }
}

/// Gives Embree the primvars that vary over faces. Topology 0 is the points'; varying primvars share one more, and
/// each face-varying one has its own.
pub(super) fn build_primvars(
    handle: &Handle,
    mesh: &ControlMesh,
    primvars: &[usize],
) -> Result<Vec<Slot>> {
    let mut topologies: Vec<(Vec<u32>, sys::RTCSubdivisionMode)> = Vec::new();
    let mut varying = None;
    let mut attributes: Vec<(u32, usize, Vec<f32>)> = Vec::new();
    let mut slots = Vec::new();
    for &i in primvars {
        let primvar = &mesh.primvars[i];
        let width = primvar.width as usize;
        if width > 16 {
            return Err(Fault::new(format!(
                "primvar {} has {width} components, more than 16",
                primvar.name
            ))
            .into());
        }
        let (topology, values) = match primvar.interpolation {
            Interpolation::Constant | Interpolation::Uniform => {
                slots.push(Slot::Plain(i));
                continue;
            }
            Interpolation::Vertex => (0, per_point(mesh, primvar)),
            Interpolation::Varying => {
                let topology = *varying.get_or_insert_with(|| {
                    topologies.push((
                        mesh.face_vertex_indices.clone(),
                        sys::RTC_SUBDIVISION_MODE_PIN_ALL,
                    ));
                    topologies.len() as u32
                });
                (topology, per_point(mesh, primvar))
            }
            Interpolation::FaceVarying => {
                let (indices, values) = per_corner(mesh, primvar);
                topologies.push((indices, face_varying_mode(mesh)));
                (topologies.len() as u32, values)
            }
        };
        slots.push(Slot::Attribute(attributes.len() as u32, width));
        attributes.push((topology, width, values));
    }
    // SAFETY: the geometry is alive and a subdivision surface.
    unsafe {
        sys::rtcSetGeometryTopologyCount(handle.raw(), topologies.len() as u32 + 1);
        sys::rtcSetGeometryVertexAttributeCount(handle.raw(), attributes.len() as u32);
    }
    for (number, (indices, mode)) in (1..).zip(&topologies) {
        handle.fill(
            sys::RTC_BUFFER_TYPE_INDEX,
            number,
            sys::RTC_FORMAT_UINT,
            1,
            indices,
        )?;
        // SAFETY: as above; the topology exists.
        unsafe { sys::rtcSetGeometrySubdivisionMode(handle.raw(), number, *mode) };
    }
    for (number, (topology, width, values)) in (0..).zip(&attributes) {
        // Formats of 1 to 16 floats follow one another.
        let format = sys::RTC_FORMAT_FLOAT + *width as u32 - 1;
        handle.fill(
            sys::RTC_BUFFER_TYPE_VERTEX_ATTRIBUTE,
            number,
            format,
            *width,
            values,
        )?;
        // SAFETY: as above; attribute and topology exist.
        unsafe { sys::rtcSetGeometryVertexAttributeTopology(handle.raw(), number, *topology) };
    }
    handle.device.check()?;
    Ok(slots)
}

fn face_varying_mode(mesh: &ControlMesh) -> sys::RTCSubdivisionMode {
    use FaceVaryingInterpolation as F;
    match mesh.face_varying {
        _ if mesh.scheme == Scheme::Bilinear => sys::RTC_SUBDIVISION_MODE_PIN_ALL,
        F::None => sys::RTC_SUBDIVISION_MODE_SMOOTH_BOUNDARY,
        F::CornersOnly | F::CornersPlus1 | F::CornersPlus2 => sys::RTC_SUBDIVISION_MODE_PIN_CORNERS,
        F::Boundaries => sys::RTC_SUBDIVISION_MODE_PIN_BOUNDARY,
        F::All => sys::RTC_SUBDIVISION_MODE_PIN_ALL,
    }
}

fn per_point(mesh: &ControlMesh, primvar: &Primvar) -> Vec<f32> {
    (0..mesh.point_count())
        .flat_map(|i| primvar.get(i))
        .copied()
        .collect()
}

/// Corners of one point with one value are one; others are apart, even if they have the same element, so that
/// the topology is that of the points, cut at seams.
fn per_corner(mesh: &ControlMesh, primvar: &Primvar) -> (Vec<u32>, Vec<f32>) {
    let mut known: HashMap<(u32, Vec<u32>), u32> = HashMap::new();
    let mut values = Vec::new();
    let indices = mesh
        .face_vertex_indices
        .iter()
        .enumerate()
        .map(|(corner, &point)| {
            let value = primvar.get(corner);
            let key = match &primvar.indices {
                Some(indices) => vec![indices[corner]],
                None => value.iter().map(|x| x.to_bits()).collect(),
            };
            let next = known.len() as u32;
            *known.entry((point, key)).or_insert_with(|| {
                values.extend_from_slice(value);
                next
            })
        })
        .collect();
    (indices, values)
}
