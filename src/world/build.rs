//! From a description to a world: Embree's geometries, materials and lights.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::geometry::{Made, Maker};
use super::method::{Choice, Method};
use super::plan::{Item, expected, plan};
use super::prepare::{Form, Prepared, Preparer};
use super::shape::Shape;
use super::stand::Stand;
use super::stored::Source;
use super::textures::Textures;
use super::worn::{Wardrobe, Wearer};
use super::{Entry, Placed, World};
use crate::accel::{Cache, CacheSize, Intersector, MaxError};
use crate::error::{Error, Fault, Result, Warnings};
use crate::image::{PtexFilter, Texture};
use crate::math::{Affine3A, Bounds3, DAffine3, Vec3, Vec4};
use crate::memory::resident;
use crate::mesh::ControlMesh;
use crate::scene::{self, Description};
use crate::shade::camera::Camera;
use crate::shade::light::{Lights, Radiance};
use crate::shade::material::Material;
use crate::stats::{AchievedError, ObjectStats};
use crate::store::{Store, Writer};
use crate::surface::Dicing;
use crate::trace::{Device, Geometry, Scene, SceneBuilder};

/// How to build.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// How surfaces are traced.
    pub method: Choice,
    /// How finely they are diced.
    pub dicing: Dicing,
    /// For rays of paths that have bounced, micro-edges are so many times as long, above 1; none for the same. Methods that
    /// are not [diced](Method::is_diced), and what was stored, show them what all others see.
    pub bounce_dicing: Option<f32>,
    /// The farthest that a method which compresses may move a micro-vertex.
    pub max_error: MaxError,
    /// Bytes of the cache, for the method that has one. None for the usual size, but no more than an eighth of the memory
    /// budget; where methods are chosen, for what is left.
    pub cache_size: Option<CacheSize>,
    /// Everything Lambert with this albedo; displacement stays.
    pub clay: Option<f32>,
    /// Textures that cannot be read become this colour instead of an error.
    pub missing_textures: Option<Vec4>,
    /// How Ptex files are looked up, whatever the scene says; displacement always is consistently.
    pub ptex_filter: Option<PtexFilter>,
    /// Bytes that the program holds beside the world: a film. They count where methods are chosen.
    pub held_beside: usize,
    /// Radiance of the dome that lights a scene without lights.
    pub default_dome: f32,
}

/// A world and what it was built of.
pub struct Built {
    /// Ready for rays.
    pub world: World,
    /// Bytes of textures.
    pub texture_bytes: usize,
    /// Bytes of limit surfaces, and of what the method holds beside Embree.
    pub surface_bytes: usize,
    /// How far micro-vertices were moved, by methods that do.
    pub error: Option<AchievedError>,
    /// What is diced while rays are traced, by the method that does so.
    pub cache: Option<Arc<Cache>>,
    /// How each object is traced, and what it was expected to take.
    pub objects: Vec<ObjectStats>,
    /// Bytes of texels that Ptex files may hold beside those that they hold now.
    pub ptex_room: usize,
    /// What was noticed.
    pub warnings: Warnings,
}

impl World {
    /// Builds everything that rays need. `go_on` is told how far the build is, 0..1, and may end it by `false`.
    ///
    /// # Errors
    /// Textures that cannot be read, meshes that Embree cannot hold, a memory budget that does not suffice,
    /// an end by `go_on`.
    pub fn build(
        description: &Description,
        camera: &Camera,
        device: &Device,
        options: &BuildOptions,
        go_on: &(dyn Fn(f64) -> bool + Sync),
    ) -> Result<Built> {
        Self::from(description, camera, device, options, Source::Built, go_on)
    }

    /// The same, and writes what the method builds to a store.
    ///
    /// # Errors
    /// As [`build`](Self::build), and if the store cannot be written.
    ///
    /// # Panics
    /// If the method [is not stored](Method::is_stored).
    pub fn record(
        description: &Description,
        camera: &Camera,
        device: &Device,
        options: &BuildOptions,
        store: &mut Writer,
        go_on: &(dyn Fn(f64) -> bool + Sync),
    ) -> Result<Built> {
        let source = Source::Recorded(store);
        Self::from(description, camera, device, options, source, go_on)
    }

    /// The same with what lies in a store, so that nothing is built.
    ///
    /// # Errors
    /// As [`build`](Self::build), and if the store holds something else, or is damaged.
    ///
    /// # Panics
    /// If the method [is not stored](Method::is_stored).
    pub fn stored(
        description: &Description,
        camera: &Camera,
        device: &Device,
        options: &BuildOptions,
        store: &Store,
        go_on: &(dyn Fn(f64) -> bool + Sync),
    ) -> Result<Built> {
        let source = Source::Stored(store);
        Self::from(description, camera, device, options, source, go_on)
    }

    fn from(
        description: &Description,
        camera: &Camera,
        device: &Device,
        options: &BuildOptions,
        source: Source<'_>,
        go_on: &(dyn Fn(f64) -> bool + Sync),
    ) -> Result<Built> {
        let is_stored = matches!(options.method, Choice::One(method) if method.is_stored());
        assert!(
            matches!(source, Source::Built) || is_stored,
            "{} is not stored",
            options.method.name()
        );
        if options.bounce_dicing.is_some() && !matches!(source, Source::Built) {
            return Err(Error::usage(
                "surfaces are to be diced otherwise for bounces, where hierarchies are stored",
                "leave --bounce-dicing out, or render without a store: stores hold one dicing",
            ));
        }
        let budget = device.memory_budget();
        let mut warnings = Warnings::default();
        let textures = Textures::load(description, options, budget, &mut warnings)?;
        let (materials, unbound) = textures.materials(description, options);
        let mut wardrobe = Wardrobe::new(materials.clone());
        let mut preparer = Preparer::new(
            description,
            camera,
            options,
            &textures,
            (&materials, unbound),
            budget,
        );
        let prepared = preparer.all(&source, &mut warnings, &|| go_on_or_stop(go_on, 0.0))?;
        drop(preparer);
        budget.promise(textures.room());
        if let Source::Stored(store) = &source {
            budget.ask(store.size(), "the hierarchies that were built")?;
        }
        let known = options.held_beside as u64 + known(description, &prepared, &textures);
        let plan = plan(&prepared, options, budget, known)?;
        if let Some(size) = plan.cache {
            budget.ask(size.0 as u64, "the cache")?;
        }
        let before = resident();
        let cache = Method::Cache.cache(plan.cache.unwrap_or(CacheSize(0)));
        let written = resident().unwrap_or(0).saturating_sub(before.unwrap_or(0));
        let has_cache = plan.cache.is_some();
        let cache_bytes = if has_cache { cache.bytes() } else { 0 };
        // What fills while rays are traced.
        let unwritten = cache_bytes.saturating_sub(written);
        let promise = || budget.promise(textures.room() + unwritten);
        promise();
        let objects: Vec<ObjectStats> = (prepared.iter().zip(&plan.items).zip(&plan.methods))
            .map(|((prepared, item), &method)| object_stats(prepared, item, method))
            .collect();
        let mut maker = Maker {
            device,
            options,
            source,
            go_on: &|done| {
                promise();
                go_on(0.5 * done)
            },
            share: [0.0; 2],
            cache: &cache,
            bytes: cache_bytes,
            error: None,
        };

        let mut scenes = Scenes::new(device, options)?;
        let mut entries: BTreeMap<u32, Entry> = BTreeMap::new();
        let mut shapes = Vec::with_capacity(description.shapes.len());
        let mut placed: Vec<Option<Placed>> =
            (0..description.placements.len()).map(|_| None).collect();
        let mut bounds = Bounds3::EMPTY;
        let mut transparent = false;
        let shapes_and_methods = description.shapes.iter().zip(prepared).zip(plan.methods);
        for (number, ((shape, prepared), method)) in shapes_and_methods.enumerate() {
            maker.share = [number, number + 1].map(|n| n as f64 / description.shapes.len() as f64);
            go_on_or_stop(go_on, 0.5 * maker.share[0])?;
            let keys = |place: u32| -> Vec<Affine3A> {
                description.placements[place as usize]
                    .world_from_object
                    .iter()
                    .map(single)
                    .collect()
            };
            let (places, in_world) = (prepared.places.clone(), prepared.in_world);
            for &place in &places {
                for key in keys(place) {
                    bounds = bounds.union(shape.geometry.bounds().transformed(&key));
                }
            }
            let made = maker.make(prepared, method, &mut warnings);
            let made = made.map_err(|e| name_shape(e, description, shape))?;
            let Made {
                geometry,
                bounced,
                surface,
            } = made;
            let mut wearer = Wearer::new(
                &mut wardrobe,
                &shape.geometry,
                &surface,
                &places,
                description,
            );
            let worn = wearer.by_face(&shape.materials);
            let mut place_of = |place: u32, stand: Stand| {
                let placement = &description.placements[place as usize];
                Placed {
                    shape: number as u32,
                    stand,
                    worn: placement
                        .material
                        .filter(|_| options.clay.is_none())
                        .map(|m| wearer.number(Some(m))),
                    display_color: placement.display_color.map(Into::into),
                }
            };
            if in_world.is_some() {
                let id = scenes.attach(geometry, bounced);
                entries.insert(id, Entry::Placed(places[0]));
                placed[places[0] as usize] = Some(place_of(places[0], Stand::InWorld));
            } else if !places.is_empty() {
                let own = |geometry: Geometry| -> Result<Arc<Scene>> {
                    let mut own = SceneBuilder::new(device, options.method.scene_options())?;
                    own.attach(geometry);
                    Ok(Arc::new(own.commit(&|_| go_on(0.5 * maker.share[1]))?))
                };
                let (own, bounced) = (own(geometry)?, bounced.map(own).transpose()?);
                for place in places {
                    let id = scenes.instance((&own, bounced.as_ref()), &keys(place))?;
                    entries.insert(id, Entry::Placed(place));
                    placed[place as usize] = Some(place_of(place, Stand::new(keys(place))));
                }
            }
            transparent |= wearer.transparent;
            shapes.push(Shape { surface, worn });
        }

        let lights = lights(
            description,
            &textures.images,
            camera,
            bounds,
            options,
            &mut warnings,
        );
        if let Some(area) = lights.shapes() {
            let (triangles, corners) = area.triangles();
            if !triangles.is_empty() {
                let rectangles = Geometry::triangles(device, triangles, Arc::new(vec![corners]))?;
                entries.insert(scenes.attach(rectangles, None), Entry::Rectangles);
            }
            if area.primitives() > 0 {
                let others = Geometry::user(device, Arc::clone(area))?;
                entries.insert(scenes.attach(others, None), Entry::Lights);
            }
        }
        let (scene, bounced) = scenes.commit(&|done| go_on(0.5 + 0.5 * done))?;
        let last = entries.keys().next_back().map_or(0, |&id| id as usize + 1);
        let mut by_number = vec![Entry::Lights; last];
        for (id, entry) in entries {
            by_number[id as usize] = entry;
        }
        let world = Self {
            scene,
            bounced,
            entries: by_number,
            shapes,
            placed: placed
                .into_iter()
                .map(|p| p.expect("every placement names a shape"))
                .collect(),
            worn: wardrobe.worn,
            ptex: textures.files().cloned().collect(),
            lights_are_split: (0..description.lights.len().max(1))
                .any(|i| lights.multipliers(i) != [1.0, 1.0]),
            lights,
            transparent,
            moves: description.shapes.iter().any(|s| s.geometry.keys() > 1)
                || (description.placements.iter()).any(|p| p.world_from_object.len() > 1),
        };
        world.check_textures()?;
        Ok(Built {
            world,
            texture_bytes: textures.memory(),
            surface_bytes: maker.bytes,
            error: maker.error,
            cache: has_cache.then_some(cache),
            objects,
            ptex_room: textures.room(),
            warnings,
        })
    }
}

/// What rays meet, and what those of paths that have bounced do, under the same numbers.
struct Scenes {
    all: SceneBuilder,
    bounced: Option<SceneBuilder>,
}

impl Scenes {
    fn new(device: &Device, options: &BuildOptions) -> Result<Self> {
        let builder = || SceneBuilder::new(device, options.method.scene_options());
        Ok(Self {
            all: builder()?,
            bounced: options.bounce_dicing.map(|_| builder()).transpose()?,
        })
    }

    fn attach(&mut self, geometry: Geometry, bounced: Option<Geometry>) -> u32 {
        let geometry = Arc::new(geometry);
        if let Some(scene) = &mut self.bounced {
            scene.attach(bounced.map_or_else(|| geometry.clone(), Arc::new));
        }
        self.all.attach(geometry)
    }

    fn instance(
        &mut self,
        (own, bounced): (&Arc<Scene>, Option<&Arc<Scene>>),
        world_from_object: &[Affine3A],
    ) -> Result<u32> {
        if let Some(scene) = &mut self.bounced {
            scene.instance(bounced.unwrap_or(own).clone(), world_from_object)?;
        }
        self.all.instance(own.clone(), world_from_object)
    }

    fn commit(self, progress: &(dyn Fn(f64) -> bool + Sync)) -> Result<(Scene, Option<Scene>)> {
        let bounced = self.bounced.map(|scene| scene.commit(&|_| progress(0.0)));
        Ok((self.all.commit(progress)?, bounced.transpose()?))
    }
}

/// Bytes of all that is there beside the shapes' hierarchies, as far as they are known.
fn known(description: &Description, prepared: &[Prepared<'_>], textures: &Textures) -> u64 {
    // What it was read from, too.
    let meshes = |shape: &scene::Shape| 2 * shape.geometry.memory();
    let meshes: usize = description.shapes.iter().map(meshes).sum();
    let surfaces: usize = prepared.iter().map(Prepared::memory).sum();
    (meshes + surfaces + textures.memory() + textures.room()) as u64
}

fn object_stats(prepared: &Prepared<'_>, item: &Item, method: Method) -> ObjectStats {
    let (micro_triangles, need) = expected(prepared, item, method);
    ObjectStats {
        path: prepared.wanted.path.to_owned(),
        method: match prepared.form {
            Form::Polygons(_) => "polygons",
            Form::Smooth(_) if item.counts.is_tiled() && !method.copies_tiles() => "tiles",
            Form::Smooth(_) => method.name(),
        },
        micro_triangles,
        expected_bytes: need.held,
    }
}

fn go_on_or_stop(go_on: &(dyn Fn(f64) -> bool + Sync), done: f64) -> Result<()> {
    if go_on(done) {
        Ok(())
    } else {
        Err(Error::Interrupted)
    }
}

pub(super) fn name_shape(error: Error, description: &Description, shape: &scene::Shape) -> Error {
    match error {
        Error::Input(fault) => {
            let fault = fault.at_prim(&shape.path);
            match description.files.first() {
                Some(file) => fault.in_file(file).into(),
                None => fault.into(),
            }
        }
        other => other,
    }
}

/// The materials that may cover a shape, in any of its places.
pub(super) fn covering<'a>(
    shape: &'a scene::Shape,
    places: &'a [u32],
    description: &'a Description,
) -> impl Iterator<Item = Option<usize>> + 'a {
    std::iter::once(shape.materials.whole)
        .chain(shape.materials.subsets.iter().map(|s| s.material))
        .chain(
            places
                .iter()
                .filter_map(|&p| description.placements[p as usize].material.map(Some)),
        )
}

/// The primvars that the materials on a shape read, and that its tiles lie by, and it has.
///
/// # Errors
/// One that it should have had: the file gives it, but not for this mesh.
pub(super) fn needed_primvars(
    shape: &scene::Shape,
    places: &[u32],
    description: &Description,
    materials: &[Material],
    unbound: usize,
) -> Result<Vec<String>, Fault> {
    let mut needs = Vec::new();
    for covering in covering(shape, places, description) {
        let material = &materials[covering.unwrap_or(unbound)];
        for name in [material.needs(), material.displacement_needs()].concat() {
            let unusable = shape.unusable_primvars.iter().find(|p| p.name == name);
            if let Some(unusable) = unusable {
                let reader =
                    covering.map_or("the surface's colour", |m| &description.materials[m].path);
                let mut fault = unusable.fault.clone();
                fault.message += &format!(", and {reader} reads it");
                return Err(fault);
            }
            // A patch has texture coordinates in any case.
            let is_patch = matches!(shape.geometry, scene::Geometry::Nurbs(_));
            if shape.geometry.primvar(name).is_some() || is_patch && name == "st" {
                needs.push(name.to_owned());
            }
        }
    }
    let tiles = shape.tiles.as_ref().map(|tiles| tiles.primvar.clone());
    needs.extend(tiles.filter(|name| shape.geometry.primvar(name).is_some()));
    needs.sort();
    needs.dedup();
    Ok(needs)
}

/// The displacing material that covers all of a shape.
pub(super) fn displacement_of(
    shape: &scene::Shape,
    places: &[u32],
    description: &Description,
    materials: &[Material],
) -> Option<usize> {
    let by_place = places
        .iter()
        .filter_map(|&p| description.placements[p as usize].material);
    shape
        .materials
        .whole
        .into_iter()
        .chain(by_place)
        .find(|&m| materials[m].is_displaced())
}

pub(super) fn in_space(mesh: &ControlMesh, world_from_object: &Affine3A) -> ControlMesh {
    let mut mesh = mesh.clone();
    for point in mesh.points.iter_mut().flatten() {
        *point = world_from_object.transform_point3(*point);
    }
    let object_from_world = world_from_object.inverse();
    if let Some(normals) = &mut mesh.normals {
        for n in normals.values.chunks_exact_mut(3) {
            let v = glam::Vec3A::from_slice(n);
            n.copy_from_slice(&(object_from_world.matrix3.transpose() * v).to_array());
        }
    }
    // A mirror image turns the faces round.
    if world_from_object.matrix3.determinant() < 0.0 {
        mesh.left_handed = !mesh.left_handed;
    }
    mesh
}

fn lights(
    description: &Description,
    textures: &[Arc<Texture>],
    camera: &Camera,
    bounds: Bounds3,
    options: &BuildOptions,
    warnings: &mut Warnings,
) -> Lights {
    if description.lights.is_empty() && description.cameras.is_empty() {
        return Lights::new(&studio(camera), &[], bounds).0;
    }
    if description.lights.is_empty() {
        warnings.add("no light", || {
            "the scene has no light: a white dome lights it; author a light to replace it"
                .to_owned()
        });
        return Lights::default_dome(Vec3::splat(options.default_dome));
    }
    let textures: Vec<_> = textures
        .iter()
        .map(|t| Some(t.clone() as Arc<dyn Radiance>))
        .collect();
    let (lights, noticed) = Lights::new(&description.lights, &textures, bounds);
    warnings.extend(noticed);
    lights
}

/// Lights for a bare mesh: a soft key from the upper left of the camera, and a grey dome that fills the shadows.
fn studio(camera: &Camera) -> [scene::Light; 2] {
    let light = |path: &str, kind, world_from_light, color| scene::Light {
        path: path.to_owned(),
        kind,
        world_from_light,
        color,
        normalize: true,
        diffuse: 1.0,
        specular: 1.0,
        texture: None,
        shaping: None,
    };
    // A light shines along its -Z as a camera looks along its own: turn the camera's frame.
    let turned = glam::DQuat::from_rotation_y(-0.75) * glam::DQuat::from_rotation_x(-0.7);
    let mut key = camera.world_from_camera(0.0) * DAffine3::from_quat(turned);
    key.translation = glam::DVec3::ZERO;
    [
        light(
            "studio key",
            scene::LightKind::Distant { angle: 20.0 },
            key,
            Vec3::new(6.2, 5.9, 5.5),
        ),
        light(
            "studio fill",
            scene::LightKind::Dome,
            DAffine3::IDENTITY,
            Vec3::new(0.42, 0.45, 0.5),
        ),
    ]
}

/// Transforms are composed in double precision and used in single.
pub(super) fn single(m: &DAffine3) -> Affine3A {
    Affine3A::from_mat3_translation(m.matrix3.as_mat3(), m.translation.as_vec3())
}

impl Radiance for Texture {
    fn eval(&self, st: crate::math::Vec2) -> Vec4 {
        Self::eval(self, st)
    }

    fn size(&self) -> [u32; 2] {
        Self::size(self)
    }

    fn texel(&self, x: u32, y: u32) -> Vec4 {
        Self::texel(self, x, y)
    }
}
