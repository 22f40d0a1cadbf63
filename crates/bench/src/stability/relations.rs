//! Relations: changes of a scan, of a file or of a camera that must not change a picture. What is
//! changed exactly must give equal pixels. What chooses other points for the levels of detail must
//! differ no more than another choice does, which moving the scan by some steps gives: the floor.
//! `crates/engine/tests/relations.rs` and `windows.rs` hold the same on one generated scan.

use crate::stability::cloud::Cloud;
use crate::stability::lab::Lab;
use crate::stability::report::{Floor, Relation, Verdict};
use anyhow::Result;
use esker_builder::Options;
use esker_engine::calls::conditions::rated::PART_SHARE;
use esker_engine::cameras::camera::{Camera, OrthoHeight};
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::pool;
use esker_format::Forest;
use esker_lod::Window;
use esker_points::Filter;
use esker_points::task::Silent;
use esker_render::Picture;
use esker_truth::flip::mean_flip;
use glam::DVec3;
use std::path::Path;

/// Methods that are compared.
const METHODS: [&str; 4] = ["points", "pull-push", "auto", "ewa"];
/// Points of a scan that are taken at most, quickly and in full.
const POINTS: [u64; 2] = [300_000, 1_000_000];
/// Exponents of two of the units, quickly and in full.
const UNITS: [&[i32]; 2] = [&[-20, 40], &[-40, -20, -1, 1, 20, 40]];
/// Offsets of headers.
const OFFSETS: [[f64; 3]; 2] = [[500_000.0, 5_400_000.0, 250.0], [-1e9, 3e9, 64.0]];
/// Greatest offset in steps: doubles have quarters of a step there, which places of cameras need.
const OFFSET_STEPS: f64 = (1u64 << 50) as f64;
/// Shifts whose greatest change of a picture is the floor, steps. Of those that only move cells,
/// the last is a share of the scan: cells of any size begin elsewhere.
const SHIFTS: [i32; 2] = [1, 777];
const SHIFT_OF_EXTENT: f64 = 0.37;
/// A change of the sample is at most this many times the floor, and this much more.
const FLOOR_FACTOR: f64 = 1.3;
const FLOOR_MORE: f64 = 0.01;
/// FLIP between views that are as good as parallel, from different distances.
const FAR_FLIP: f64 = 0.03;
/// Distances of these, in reaches.
const FAR: [f64; 2] = [2_000.0, 8_000.0];
/// Exponents of two of the distance of the camera's target: about 1 and 10^9.
const TARGETS_LOG2: [i32; 2] = [0, 30];
/// Size of the picture that is parted, pixels: wider than what is drawn around a part.
const PARTED: [u32; 2] = [900, 330];

/// Tests all relations on a scan.
///
/// # Errors
/// If it cannot be read, built or drawn.
pub(super) fn of(scan: &Path, lab: &Lab<'_>) -> Result<(Vec<Relation>, Vec<Floor>)> {
    let name = scan.file_name().unwrap_or(scan.as_os_str()).to_string_lossy().into_owned();
    lab.phase(&format!("{name}: relations"))?;
    let cloud = lab.read(scan, POINTS[usize::from(lab.is_full)])?;
    let place = Stance::of(&cloud);
    let base = lab.build(&[&cloud], &Options::default())?;
    let want = pictures(lab, &base.file, &place.cameras(1.0, [0.0; 3]))?;
    let mut tested =
        Tested { name, lab, place, want, floors: Vec::new(), rows: Vec::new(), moved: Vec::new() };
    tested.keep("", &tested.want)?;
    tested.cameras(&base.file)?;
    tested.parts(&base.file)?;
    tested.threads(&cloud)?;
    tested.exact(&cloud)?;
    tested.measure_floors(&cloud)?;
    tested.samples(&cloud)?;
    tested.formats(&cloud)?;
    Ok((tested.rows, tested.moved))
}

/// Where the camera stands, all numbers multiples of a step of the scan, so that moving and scaling
/// them is exact.
#[derive(Clone, Copy)]
struct Stance {
    centre: DVec3,
    /// About the diagonal of the scan.
    reach: f64,
}

/// Direction of view, a little more than 1 long.
const FORWARD: DVec3 = DVec3::new(0.625, 0.6875, -0.375);

impl Stance {
    fn of(cloud: &Cloud) -> Self {
        let [low, high] = cloud.raw_bounds().map(|c| DVec3::from_array(c.map(f64::from)));
        let centre = low.midpoint(high).round();
        let reach = ((high - low).length() / 16.0).ceil().max(1.0) * 16.0;
        Self { centre: centre * cloud.step, reach: reach * cloud.step }
    }

    /// Cameras of the scan in another unit, at another offset: the whole, and a nearer one.
    fn cameras(&self, unit: f64, offset: [f64; 3]) -> [Camera; 2] {
        [1.0, 0.25].map(|distance| {
            let eye = self.centre - FORWARD * self.reach * distance;
            let at = |place: DVec3| Some(place * unit + DVec3::from_array(offset));
            Camera { eye: at(eye), target: at(eye + FORWARD * self.reach), ..view_of(50.0) }
        })
    }
}

fn view_of(fovy_deg: f64) -> Camera {
    Camera { fovy_deg: Some(fovy_deg), ..Camera::default() }
}

/// The pictures of a scan, by method and camera.
type Pictures = Vec<Vec<Picture>>;

/// Draws the cameras by all methods.
fn pictures(lab: &Lab<'_>, file: &Forest, cameras: &[Camera]) -> Result<Pictures> {
    let one = |method: &&str| {
        let each = cameras.iter().map(|camera| {
            // Highlights move with the scan's axes.
            let request = PictureRequest { shines: false, ..lab.request(camera, method) };
            Ok(lab.shot(file, &request)?.picture)
        });
        each.collect()
    };
    METHODS.iter().map(one).collect()
}

/// Greatest share of the pixels that differ between pictures.
fn differing(a: &[Picture], b: &[Picture]) -> f64 {
    let share = |(a, b): (&Picture, &Picture)| {
        let pairs = a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
        pairs.filter(|(a, b)| a != b).count() as f64 / a.depth.len().max(1) as f64
    };
    a.iter().zip(b).map(share).fold(0.0, f64::max)
}

/// Greatest FLIP between pictures.
fn flip(a: &[Picture], b: &[Picture]) -> f64 {
    let one = |(a, b): (&Picture, &Picture)| mean_flip(&a.rgba, &b.rgba, a.width as usize);
    a.iter().zip(b).map(one).fold(0.0, f64::max)
}

/// A scan whose relations are tested.
struct Tested<'a> {
    name: String,
    lab: &'a Lab<'a>,
    place: Stance,
    /// Pictures of the scan as it is.
    want: Pictures,
    /// FLIP of another sample, by method.
    floors: Vec<f64>,
    rows: Vec<Relation>,
    /// What made the floors.
    moved: Vec<Floor>,
}

impl Tested<'_> {
    fn row(
        &mut self,
        relation: &'static str,
        method: &'static str,
        (measure, measured, bound): (&'static str, f64, f64),
    ) {
        let verdict = if measured <= bound { Verdict::Holds } else { Verdict::Broken };
        let scan = self.name.clone();
        self.rows.push(Relation { scan, relation, method, measure, bound, measured, verdict });
    }

    /// Compares pictures pixel by pixel with those of the scan as it is.
    fn same(&mut self, relation: &'static str, others: &[Pictures], bound: f64) {
        for (k, method) in METHODS.into_iter().enumerate() {
            let each = others.iter().map(|other| differing(&self.want[k], &other[k]));
            let measured = each.fold(0.0, f64::max);
            self.row(relation, method, ("pixels", measured, bound));
        }
    }

    /// Compares pictures with those of the scan as it is, within the floor.
    fn near(&mut self, relation: &'static str, other: &Pictures) -> Result<()> {
        self.keep(relation, other)?;
        for (k, method) in METHODS.into_iter().enumerate() {
            let measured = flip(&self.want[k], &other[k]);
            self.row(relation, method, ("flip", measured, self.bound(k)));
        }
        Ok(())
    }

    /// Writes pictures to the folder of pictures, if there is one.
    fn keep(&self, relation: &str, pictures: &Pictures) -> Result<()> {
        let name: String =
            relation.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        let scan = self.name.replace([':', '/'], "-");
        for (method, drawn) in METHODS.iter().zip(pictures) {
            for (k, picture) in drawn.iter().enumerate() {
                self.lab.keep(&format!("{scan}-{method}-{k}-{name}"), picture)?;
            }
        }
        Ok(())
    }

    /// Greatest FLIP of another sample.
    fn bound(&self, method: usize) -> f64 {
        FLOOR_FACTOR * self.floors[method] + FLOOR_MORE
    }

    /// The scan as `clouds`, by all methods.
    fn built(&self, clouds: &[&Cloud], cameras: &[Camera]) -> Result<Pictures> {
        let built = self.lab.build(clouds, &Options::default())?;
        pictures(self.lab, &built.file, cameras)
    }

    /// Changes that keep every pixel.
    fn exact(&mut self, cloud: &Cloud) -> Result<()> {
        let place = self.place;
        let mut others = Vec::new();
        for log2 in UNITS[usize::from(self.lab.is_full)] {
            let unit = 2f64.powi(*log2);
            let other = Cloud { step: cloud.step * unit, ..cloud.clone() };
            others.push(self.built(&[&other], &place.cameras(unit, [0.0; 3]))?);
        }
        self.same("unit times 2^k", &others, 0.0);
        others.clear();
        for offset in OFFSETS {
            let exact = |o: f64| (o / cloud.step).clamp(-OFFSET_STEPS, OFFSET_STEPS).round();
            let offset = offset.map(|o| exact(o) * cloud.step);
            let other = Cloud { offset, ..cloud.clone() };
            others.push(self.built(&[&other], &place.cameras(1.0, offset))?);
        }
        self.same("offset up to 10^9", &others, 0.0);
        let cameras = place.cameras(1.0, [0.0; 3]);
        let count = cloud.positions.len();
        let stride = (count / 7919).max(7);
        let shuffled = cloud.chosen((0..stride).flat_map(|i| (i..count).step_by(stride)));
        others = vec![self.built(&[&shuffled], &cameras)?];
        self.same("order of points", &others, 0.0);
        let part = |name, is_own: fn(usize) -> bool| Cloud {
            name,
            ..cloud.chosen((0..count).filter(move |i| is_own(i % 3)))
        };
        let (a, b) = (part("b", |k| k == 0), part("a", |k| k != 0));
        others = vec![self.built(&[&a, &b], &cameras)?];
        self.same("points in two files", &others, 0.0);
        Ok(())
    }

    /// Draws what moving the scan by some steps changes.
    fn measure_floors(&mut self, cloud: &Cloud) -> Result<()> {
        let scan = &self.name;
        let [low, high] = cloud.raw_bounds();
        let extent = (0..3).map(|i| high[i] - low[i]).max().unwrap_or(0);
        let share = (f64::from(extent) * SHIFT_OF_EXTENT) as i32 | 1;
        self.floors = vec![0.0; METHODS.len()];
        for steps in SHIFTS.into_iter().chain([share]) {
            let moved = cloud.moved(|p| p.map(|c| c + steps));
            let offset = [f64::from(steps) * cloud.step; 3];
            let other = self.built(&[&moved], &self.place.cameras(1.0, offset))?;
            self.keep(&format!("moved {steps} steps"), &other)?;
            for ((k, floor), method) in self.floors.iter_mut().enumerate().zip(METHODS) {
                let flip = flip(&self.want[k], &other[k]);
                *floor = floor.max(flip);
                self.moved.push(Floor { scan: scan.clone(), method, steps, flip });
            }
        }
        Ok(())
    }

    /// Changes that choose other points.
    fn samples(&mut self, cloud: &Cloud) -> Result<()> {
        let fine = Cloud { step: cloud.step / 10.0, ..cloud.moved(|p| p.map(|c| c * 10)) };
        let cameras = self.place.cameras(1.0, [0.0; 3]);
        let other = self.built(&[&fine], &cameras)?;
        self.near("step / 10", &other)?;
        let turned = cloud.moved(|[x, y, z]| [-y, x, z]);
        let turn = |place: Option<DVec3>| place.map(|p| DVec3::new(-p.y, p.x, p.z));
        let cameras = cameras.map(|camera| Camera {
            eye: turn(camera.eye),
            target: turn(camera.target),
            ..camera
        });
        let other = self.built(&[&turned], &cameras)?;
        self.near("90 degrees about z", &other)
    }

    /// Relations of cameras.
    fn cameras(&mut self, file: &Forest) -> Result<()> {
        let at = |log2: i32| {
            // Powers of two of the reach keep the direction.
            let near = self.place.reach * 2f64.powi(log2 - self.place.reach.log2().round() as i32);
            self.place.cameras(1.0, [0.0; 3]).map(|camera| {
                let eye = camera.eye.unwrap_or_default();
                Camera { target: Some(eye + FORWARD * near), ..camera }
            })
        };
        let [near, far] = TARGETS_LOG2.map(at);
        let others = [pictures(self.lab, file, &near)?, pictures(self.lab, file, &far)?];
        self.same("target at 1 or 10^9", &others, 0.0);
        let Stance { centre, reach } = self.place;
        let [near, far] = FAR.map(|times| {
            let fovy = 2.0 * (0.5 / times).atan().to_degrees();
            let eye = Some(centre - FORWARD * reach * times / FORWARD.length());
            Camera { eye, target: Some(centre), ..view_of(fovy) }
        });
        let parallel = Camera {
            direction: Some(FORWARD),
            target: Some(centre),
            ortho: Some(OrthoHeight::Units(reach)),
            ..Camera::default()
        };
        // Of all points: parallel views choose other levels of detail.
        let all = |camera: Camera| -> Result<Pictures> {
            let one = |method: &&str| {
                let request = self.lab.request(&camera, method);
                let request = PictureRequest { target_spacing_px: 0.0, shines: false, ..request };
                Ok(vec![self.lab.shot(file, &request)?.picture])
            };
            METHODS.iter().map(one).collect()
        };
        let (near, far, parallel) = (all(near)?, all(far)?, all(parallel)?);
        for (k, method) in METHODS.into_iter().enumerate() {
            let measured = flip(&near[k], &far[k]);
            self.row("field of view for distance", method, ("flip", measured, FAR_FLIP));
            let measured = flip(&far[k], &parallel[k]);
            self.row("distant is parallel", method, ("flip", measured, FAR_FLIP));
        }
        Ok(())
    }

    /// Pictures in two halves. Points are near each other on the picture of the whole scan; the
    /// axis `parts` has other distances.
    fn parts(&mut self, file: &Forest) -> Result<()> {
        let [camera, _] = self.place.cameras(1.0, [0.0; 3]);
        for method in METHODS {
            let bound = if method == "points" { 0.0 } else { PART_SHARE };
            let request = self.lab.request(&camera, method);
            let share = halves_differ(self.lab, file, &request)?;
            self.row("in two halves", method, ("pixels", share, bound));
        }
        Ok(())
    }

    /// Files and pictures by other numbers of threads.
    fn threads(&mut self, cloud: &Cloud) -> Result<()> {
        let (lab, cameras) = (self.lab, self.place.cameras(1.0, [0.0; 3]));
        let by = |threads: usize| {
            pool::run(threads, || {
                let built = lab.build(&[cloud], &Options::default())?;
                Ok((built.bytes()?, pictures(lab, &built.file, &cameras)?))
            })
        };
        let ((one, drawn), (three, others)) = (by(1)?, by(3)?);
        let off = one.iter().zip(&three).filter(|(a, b)| a != b).count();
        let off = off + one.len().abs_diff(three.len());
        self.row("1 or 3 threads", "file", ("bytes", off as f64, 0.0));
        self.same("1 or 3 threads", &[drawn, others], 0.0);
        Ok(())
    }

    /// The same points from LAS and from PLY.
    fn formats(&mut self, cloud: &Cloud) -> Result<()> {
        let base = self.lab.build(&[cloud], &Options::default())?;
        let cameras = self.place.cameras(1.0, [0.0; 3]);
        let folder = self.lab.folder().to_owned();
        let (las, ply) = (folder.join("scan.las"), folder.join("scan.ply"));
        let mut drawn = Vec::new();
        for path in [&las, &ply] {
            let _ = std::fs::remove_file(path);
            esker_builder::export(&base.file, path, &Filter::default(), &Silent)?;
        }
        drop(base);
        for path in [las, ply] {
            let built = self.lab.build_file(&path)?;
            drawn.push(pictures(self.lab, &built.file, &cameras)?);
        }
        for (k, method) in METHODS.into_iter().enumerate() {
            let measured = flip(&drawn[0][k], &drawn[1][k]);
            self.row("LAS or PLY", method, ("flip", measured, self.bound(k)));
        }
        Ok(())
    }
}

/// Share of the pixels that differ between a picture and its two halves, drawn one by one.
///
/// # Errors
/// If they cannot be drawn.
pub(super) fn halves_differ(lab: &Lab<'_>, file: &Forest, request: &PictureRequest) -> Result<f64> {
    let [width, height] = PARTED;
    let request = PictureRequest { size: PARTED, ..request.clone() };
    let whole = lab.shot(file, &request)?.picture;
    let split = width * 433 / 900;
    let mut off = 0;
    for (x, part_width) in [(0, split), (split, width - split)] {
        let window = Some(Window { x, y: 0, width: part_width, height });
        let part = PictureRequest { window, ..request.clone() };
        off += differs_from_whole(&lab.shot(file, &part)?.picture, &whole, x);
    }
    Ok(f64::from(off) / f64::from(width * height))
}

/// Pixels of the part that begins at column `x` which differ from those of the whole.
fn differs_from_whole(part: &Picture, whole: &Picture, x: u32) -> u32 {
    let (own, all) = (part.rgba.as_chunks::<4>().0, whole.rgba.as_chunks::<4>().0);
    let place = |at: u32| (at / part.width * whole.width + x + at % part.width) as usize;
    let differs = |at: &u32| own[*at as usize] != all[place(*at)];
    (0..part.width * part.height).filter(differs).count() as u32
}
