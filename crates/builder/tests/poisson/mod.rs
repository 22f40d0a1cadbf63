//! A plain Poisson-disk sampler (dart throwing), and measures of a sample: its largest gap, which
//! is the greatest distance of a point of the cloud from it, and the mean distance of its points to
//! their nearest neighbours.

/// A position in metres.
pub type P = [f64; 3];

/// Square of the distance of two points.
pub fn distance2(a: &P, b: &P) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum()
}

/// Measures of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// Number of points.
    pub points: usize,
    /// Greatest distance of a point of the cloud from the sample.
    pub gap: f64,
    /// Mean distance to the nearest neighbour.
    pub nearest: f64,
}

const BUCKETS_LOG2: u32 = 12;

/// Points by the cubes that they lie in; cubes may share a bucket.
struct Grid {
    reach: f64,
    buckets: Vec<Vec<P>>,
}

impl Grid {
    /// A grid for finding points within `reach`; the edge of a cube is twice that.
    fn new(reach: f64) -> Self {
        Self { reach, buckets: vec![Vec::new(); 1 << BUCKETS_LOG2] }
    }

    /// Rounded towards zero, which works as well as rounding down: greater coordinates never give
    /// lesser cubes.
    fn cube(&self, p: &P, shift: f64) -> [i64; 3] {
        p.map(|c| ((c + shift) / (self.reach * 2.0)) as i64)
    }

    fn bucket(cube: [i64; 3]) -> usize {
        let mix = |m: u64, c: i64| (m ^ c as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (cube.into_iter().fold(0, mix) >> (64 - BUCKETS_LOG2)) as usize
    }

    fn add(&mut self, p: P) {
        let cube = self.cube(&p, 0.0);
        self.buckets[Self::bucket(cube)].push(p);
    }

    /// Square of the distance to the nearest point, apart from `p` itself if `leave_out` is set.
    /// Exact if it is within the reach.
    fn nearest2(&self, p: &P, leave_out: bool) -> f64 {
        let (low, high) = (self.cube(p, -self.reach), self.cube(p, self.reach));
        let mut nearest2 = f64::INFINITY;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    for d2 in self.buckets[Self::bucket([x, y, z])].iter().map(|q| distance2(p, q))
                    {
                        if d2 < nearest2 && !(leave_out && d2 == 0.0) {
                            nearest2 = d2;
                        }
                    }
                }
            }
        }
        nearest2
    }
}

/// Dart throwing: the cloud's points in order, each accepted if none is closer than the radius.
fn throw(cloud: &[P], radius: f64) -> Vec<P> {
    throw_indices(cloud, radius).into_iter().map(|i| cloud[i]).collect()
}

/// Variant of [`throw`] that returns indices into the cloud.
pub fn throw_indices(cloud: &[P], radius: f64) -> Vec<usize> {
    let mut grid = Grid::new(radius);
    let mut sample = Vec::new();
    for (i, p) in cloud.iter().enumerate() {
        if grid.nearest2(p, false) >= radius * radius {
            grid.add(*p);
            sample.push(i);
        }
    }
    sample
}

/// Poisson-disk samples of a cloud, with the requested number of points within one in sixty, where
/// the cloud allows it.
pub struct Poisson<'a> {
    /// In random order.
    cloud: &'a [P],
    /// Measures of the last sample.
    last: Spread,
    /// Points and radius of the last sample.
    points: usize,
    pub radius: f64,
}

impl<'a> Poisson<'a> {
    /// Samples a cloud that is in random order.
    pub fn new(cloud: &'a [P]) -> Self {
        let extent = (0..3).map(|i| {
            let along = cloud.iter().map(|p| p[i]);
            along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
        });
        let radius = extent.fold(0.0, f64::max);
        let last = Spread { points: 1, gap: 0.0, nearest: 0.0 };
        Self { cloud, last, points: 1, radius }
    }

    /// Measures the sample of about `count` points.
    pub fn of(&mut self, count: usize) -> Spread {
        if self.last.points.abs_diff(count) * 60 > count {
            let sample = self.sample(count);
            self.last = self.measure(&sample);
        }
        self.last
    }

    /// The sample of about `count` points; its radius is searched from that of the last one.
    pub fn sample(&mut self, count: usize) -> Vec<P> {
        let off = |points: usize| points.abs_diff(count) * 60;
        let (mut low, mut high) = (0.0, f64::INFINITY);
        let mut best = (0, self.radius);
        let mut radius = self.radius * (self.points as f64 / count as f64).sqrt();
        for _ in 0..12 {
            let found = throw(self.cloud, radius).len();
            if off(found) < off(best.0) {
                best = (found, radius);
            }
            if off(found) <= count {
                break;
            }
            if found > count {
                low = radius
            } else {
                high = radius
            }
            let next = radius * (found as f64 / count as f64).sqrt();
            radius = match (next > low && next < high, high.is_finite()) {
                (true, _) => next,
                (false, true) => (low + high) / 2.0,
                (false, false) => low * 1.5,
            };
        }
        (self.points, self.radius) = best;
        throw(self.cloud, self.radius)
    }

    /// No point of the cloud is farther from the sample than its radius; few have no neighbour
    /// within twice that.
    fn measure(&self, sample: &[P]) -> Spread {
        let (mut near, mut far) = (Grid::new(self.radius), Grid::new(self.radius * 2.0));
        sample.iter().for_each(|p| near.add(*p));
        sample.iter().for_each(|p| far.add(*p));
        let gaps2 = self.cloud.iter().map(|p| near.nearest2(p, false));
        let gap2 = gaps2.fold(0.0, f64::max);
        let nearest = |p: &P| {
            let found = far.nearest2(p, true);
            let all = || sample.iter().map(|q| distance2(p, q)).filter(|d2| *d2 > 0.0);
            let is_near = found <= (self.radius * 2.0).powi(2);
            if is_near { found } else { all().fold(f64::INFINITY, f64::min) }.sqrt()
        };
        let sum: f64 = sample.iter().map(nearest).sum();
        Spread { points: sample.len(), gap: gap2.sqrt(), nearest: sum / sample.len() as f64 }
    }
}

/// A sample that grows and is measured as it does.
pub struct Growing<'a> {
    cloud: &'a [P],
    sample: Vec<P>,
    /// Squared distance of each point of the cloud to the sample.
    from2: Vec<f64>,
    /// Squared distance of each point of the sample to its nearest neighbour.
    nearest2: Vec<f64>,
}

impl<'a> Growing<'a> {
    /// Begins with an empty sample of a cloud.
    pub fn new(cloud: &'a [P]) -> Self {
        let from2 = vec![f64::INFINITY; cloud.len()];
        Self { cloud, sample: Vec::new(), from2, nearest2: Vec::new() }
    }

    /// Adds points to the sample.
    pub fn add(&mut self, points: &[P]) {
        for p in points {
            for (from2, q) in self.from2.iter_mut().zip(self.cloud) {
                *from2 = from2.min(distance2(p, q));
            }
            let mut nearest2 = f64::INFINITY;
            for (other2, q) in self.nearest2.iter_mut().zip(&self.sample) {
                let d2 = distance2(p, q);
                *other2 = other2.min(d2);
                nearest2 = nearest2.min(d2);
            }
            self.sample.push(*p);
            self.nearest2.push(nearest2);
        }
    }

    /// Measures the sample.
    pub fn spread(&self) -> Spread {
        let sum: f64 = self.nearest2.iter().map(|d2| d2.sqrt()).sum();
        Spread {
            points: self.sample.len(),
            gap: self.from2.iter().fold(0.0, |m: f64, d2| m.max(*d2)).sqrt(),
            nearest: sum / self.sample.len() as f64,
        }
    }
}
