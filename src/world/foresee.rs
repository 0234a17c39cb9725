//! What a scene will take, told before it is built.

use super::build::BuildOptions;
use super::estimate::Counts;
use super::method::Method;
use super::plan::{Item, choose, items, peak, polygons, to_spend};
use super::prepare::{Form, Prepared, Preparer};
use super::stored::Source;
use super::textures::Textures;
use crate::error::{Result, Warnings};
use crate::memory::Budget;
use crate::scene::Description;
use crate::shade::camera::Camera;
use crate::surface::{Rates, Surface};

/// What surfaces will take.
#[derive(Debug, Clone)]
pub struct Foreseen {
    /// Each shape of the scene.
    pub objects: Vec<ObjectForeseen>,
    /// The most that all of them take at once by each method, in the order of [`Method::ALL`], without the cache.
    pub together: Vec<u64>,
    /// The same by the methods that would be chosen.
    pub chosen: u64,
    /// The cache then, if any of them is `cache`.
    pub cache: u64,
    /// Images, and texels of Ptex files that displace.
    pub textures: u64,
    /// Limit surfaces.
    pub surfaces: u64,
}

/// What a shape will take.
#[derive(Debug, Clone)]
pub struct ObjectForeseen {
    /// The prim.
    pub path: String,
    /// What it is diced into; none for polygons.
    pub micro_triangles: Option<u64>,
    /// The most bytes that it takes at once, by each method in the order of [`Method::ALL`].
    pub bytes: Vec<u64>,
    /// The method that would be chosen for it.
    pub chosen: Method,
}

/// What [`World::build`](super::World::build) would take by each method, and what [`Choice::Auto`](super::Choice) would
/// choose. Displacement is looked up, so its textures are read.
///
/// # Errors
/// As for the build, as far as that comes before dicing.
pub fn foresee(
    description: &Description,
    camera: &Camera,
    options: &BuildOptions,
    budget: &Budget,
) -> Result<Foreseen> {
    let mut warnings = Warnings::default();
    let none = Budget::default();
    let textures = Textures::load(description, options, &none, &mut warnings)?;
    let (materials, unbound) = textures.materials(description, options);
    let mut preparer = Preparer::new(
        description,
        camera,
        options,
        &textures,
        (&materials, unbound),
        &none,
    );
    let prepared = preparer.all(&Source::Built, &mut warnings, &|| Ok(()))?;
    let surfaces: usize = prepared.iter().map(Prepared::memory).sum();
    let meshes: usize = (description.shapes.iter())
        .map(|shape| 2 * shape.geometry.memory())
        .sum();
    let items = items(&prepared, None, options.bounce_dicing);
    let polygons_bytes = polygons(&prepared);
    let known = options.held_beside + meshes + surfaces + textures.memory();
    let (methods, cache) = choose(&items, to_spend(budget, known as u64 + polygons_bytes));
    let objects = (prepared.iter().zip(&items).zip(&methods)).map(|((p, item), &chosen)| {
        let is_smooth = matches!(p.form, Form::Smooth(_));
        let bytes = |method: Method| {
            if is_smooth {
                item.need(method).peak()
            } else {
                polygons(std::slice::from_ref(p))
            }
        };
        ObjectForeseen {
            path: p.wanted.path.to_owned(),
            micro_triangles: is_smooth.then_some(item.counts.micro_triangles),
            bytes: Method::ALL.into_iter().map(bytes).collect(),
            chosen,
        }
    });
    let all = |method: Method| peak(&items, &vec![method; items.len()]) + polygons_bytes;
    Ok(Foreseen {
        together: Method::ALL.into_iter().map(all).collect(),
        chosen: peak(&items, &methods) + polygons_bytes,
        cache: if methods.contains(&Method::Cache) {
            cache
        } else {
            0
        },
        textures: textures.memory() as u64,
        surfaces: surfaces as u64,
        objects: objects.collect(),
    })
}

/// The methods that [`Choice::Auto`](super::Choice) chooses for surfaces of which nothing else is known, within a budget, or
/// half of the machine's memory.
pub fn chosen<'a>(
    surfaces: impl Iterator<Item = (&'a Surface, &'a Rates)>,
    budget: &Budget,
) -> Vec<Method> {
    let items: Vec<Item> = surfaces
        .map(|(surface, rates)| Item {
            counts: Counts::new(surface, rates),
            bounced: None,
            together: false,
        })
        .collect();
    choose(&items, to_spend(budget, 0)).0
}
