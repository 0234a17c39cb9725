//! Hierarchies that are kept in a store, and the digests of what they follow from.

use std::sync::Arc;

use super::build::BuildOptions;
use super::method::Method;
use super::prepare::Wanted;
use crate::mesh::{ControlMesh, NurbsPatch, Primvar};
use crate::scene::Input;
use crate::shade::camera::Camera;
use crate::store::{Digest, Store, Writer};
use crate::surface::Places;

/// Where hierarchies come from, and whether they are kept.
pub(super) enum Source<'a> {
    /// They are built.
    Built,
    /// They are built and written to a store.
    Recorded(&'a mut Writer),
    /// They were built, and lie in a store.
    Stored(&'a Store),
}

/// What a surface is made of.
pub(super) enum Cage {
    Mesh(Arc<ControlMesh>),
    Patch(Arc<NurbsPatch>),
}

/// The digest of everything that a surface's hierarchy follows from, but for the images that displace it, of which
/// `digest` knows already.
pub(super) fn digest(
    mut digest: Digest,
    cage: &Cage,
    wanted: &Wanted<'_>,
    places: &Places<'_>,
    camera: &Camera,
    (method, options): (Method, &BuildOptions),
) -> String {
    let height = wanted.displaced.map(|displaced| displaced.height);
    let read = match height {
        Some(Input::Texture(map)) => Some(map.primvar.as_str()),
        Some(Input::Primvar { name, .. }) => Some(name.as_str()),
        Some(Input::Value(_) | Input::Ptex(_)) | None => None,
    };
    let read = |primvar: &&Primvar| read == Some(&primvar.name);
    match cage {
        Cage::Mesh(mesh) => {
            add_mesh(&mut digest, mesh);
            mesh.primvars
                .iter()
                .filter(read)
                .for_each(|p| add_primvar(&mut digest, p));
        }
        Cage::Patch(patch) => {
            add_patch(&mut digest, patch);
            patch
                .primvars
                .iter()
                .filter(read)
                .for_each(|p| add_primvar(&mut digest, p));
        }
    }
    let mut height = height.cloned();
    if let Some(Input::Texture(map)) = &mut height {
        // Only a number among the scene's other images.
        map.texture = 0;
    }
    if let Some(Input::Ptex(map)) = &mut height {
        map.file = 0;
    }
    digest.text(&format!("{height:?}"));
    for place in places.world_from_object() {
        digest.numbers(&place.to_cols_array());
    }
    digest.text(&camera.view_key());
    let BuildOptions {
        method: _,
        dicing,
        max_error,
        // Of the method that is not stored.
        cache_size: _,
        // They change the picture, but no geometry; images that are missing are among those that displace.
        ptex_filter: _,
        clay: _,
        missing_textures: _,
        default_dome: _,
        held_beside: _,
        // Not stored.
        bounce_dicing: _,
    } = options;
    digest.text(&format!("{} {dicing:?} {max_error:?}", method.name()));
    digest.finish()
}

fn add_mesh(digest: &mut Digest, mesh: &ControlMesh) {
    let ControlMesh {
        scheme,
        face_vertex_counts,
        face_vertex_indices,
        points,
        creases,
        corners,
        holes,
        boundary,
        face_varying,
        triangle_rule,
        crease_method,
        left_handed,
        primvars: _,
        // Of polygons only, which have no hierarchy of ours.
        normals: _,
    } = mesh;
    digest.text(&format!(
        "mesh {scheme:?} {boundary:?} {face_varying:?} {triangle_rule:?} {crease_method:?} {left_handed}"
    ));
    digest.numbers(face_vertex_counts);
    digest.numbers(face_vertex_indices);
    for key in points {
        digest.numbers(key);
    }
    let creases: Vec<[u32; 3]> = creases
        .iter()
        .map(|crease| {
            let [a, b] = crease.vertices;
            [a, b, crease.sharpness.to_bits()]
        })
        .collect();
    digest.numbers(&creases);
    let corners: Vec<[u32; 2]> = corners
        .iter()
        .map(|corner| [corner.vertex, corner.sharpness.to_bits()])
        .collect();
    digest.numbers(&corners);
    digest.numbers(holes);
}

fn add_patch(digest: &mut Digest, patch: &NurbsPatch) {
    let NurbsPatch {
        u,
        v,
        points,
        weights,
        // Asked at each hit, not by the hierarchy.
        trims: _,
        left_handed,
        primvars: _,
    } = patch;
    digest.text(&format!("patch {left_handed}"));
    for direction in [u, v] {
        digest.text(&format!(
            "{} {} {:?} {:?}",
            direction.order, direction.count, direction.range, direction.form
        ));
        digest.numbers(&direction.knots);
    }
    for key in points {
        digest.numbers(key);
    }
    digest.text(&format!("{}", weights.is_some()));
    digest.numbers(weights.as_deref().unwrap_or_default());
}

fn add_primvar(digest: &mut Digest, primvar: &Primvar) {
    let Primvar {
        name,
        interpolation,
        width,
        values,
        indices,
    } = primvar;
    digest.text(&format!(
        "{name} {interpolation:?} {width} {}",
        indices.is_some()
    ));
    digest.numbers(values);
    digest.numbers(indices.as_deref().unwrap_or_default());
}
