//! Runs a function for each lattice point on its k nearest neighbours, which are exact within a
//! reach. Runs of an index (`knn_index.rs`) are searched in parallel (`knn_search.rs`). The result
//! for a point depends only on the points within its reach.

use crate::attributes::knn_index::KnnIndex;
use crate::attributes::knn_search::{Neighbourhood, Search};
use esker_points::morton;
use rayon::prelude::*;

/// Runs that one task searches.
const TASK_RUNS: usize = 256;

/// Parameters of a search.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// Number of neighbours.
    pub count: usize,
    /// If a function returns nothing for these, the number is doubled, up to this one.
    pub count_max: usize,
    /// Greatest distance of neighbours, in steps of the first axis.
    pub reach: f64,
}

impl KnnIndex {
    /// Calls `estimate` for every point that is `wanted` with the steps from it to its nearest
    /// neighbours, in Morton order. Returns the results of all points, `none` where there is no
    /// result.
    pub fn map<T: Copy + Send + Sync>(
        &self,
        query: &Query,
        wanted: impl Fn(usize) -> bool + Sync,
        estimate: impl Fn(&[[f64; 3]]) -> Option<T> + Sync,
        none: T,
    ) -> Vec<T> {
        self.map_placed(query, wanted, |_, found| estimate(found.steps), none)
    }

    /// Variant of [`KnnIndex::map`] that also passes the indices of the point and of its
    /// neighbours.
    pub fn map_placed<T: Copy + Send + Sync>(
        &self,
        query: &Query,
        wanted: impl Fn(usize) -> bool + Sync,
        estimate: impl Fn(usize, Neighbourhood<'_>) -> Option<T> + Sync,
        none: T,
    ) -> Vec<T> {
        let mut out = vec![none; self.points[0].len()];
        let mut tasks = Vec::new();
        let (mut rest, mut run) = (out.as_mut_slice(), 0);
        for runs in self.runs.chunks(TASK_RUNS) {
            let points = runs.iter().map(ExactSizeIterator::len).sum();
            let (part, after) = rest.split_at_mut(points);
            tasks.push((run..run + runs.len(), part));
            (rest, run) = (after, run + runs.len());
        }
        tasks.into_par_iter().for_each(|(runs, out)| {
            let first = self.runs[runs.start].start as usize;
            let mut search = Search::new(self, query.reach);
            let mut open = Vec::new();
            for run in runs {
                open.clear();
                open.extend(self.run(run).filter(|&p| wanted(p)));
                let mut count = query.count;
                while !open.is_empty() && count <= query.count_max {
                    search.around(run, count);
                    open.retain(|&place| {
                        let found = search.nearest(place, count);
                        let result = estimate(place, found);
                        if let Some(result) = result {
                            out[place - first] = result;
                        }
                        result.is_none() && found.steps.len() == count
                    });
                    count *= 2;
                }
            }
        });
        out
    }
}

/// Returns the sorted Morton codes of positions, without duplicates.
pub fn sorted_codes(positions: &[[u32; 3]]) -> Vec<u128> {
    let mut codes: Vec<u128> = positions.par_iter().map(|&p| morton::encode3(p)).collect();
    codes.par_sort_unstable();
    codes.dedup();
    codes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn distinct(points: &[[u32; 3]]) -> Vec<[u32; 3]> {
        sorted_codes(points).into_iter().map(morton::decode3).collect()
    }

    /// Nearest neighbours by brute force.
    fn plain(points: &[[u32; 3]], i: usize, scale: [f64; 3], query: &Query) -> Vec<[f64; 3]> {
        let aspect = scale.map(|s| s / scale[0]);
        let mut all: Vec<(u32, usize, [f64; 3])> = Vec::new();
        for (j, q) in points.iter().enumerate().filter(|&(j, _)| j != i) {
            let step = [0, 1, 2].map(|a| f64::from(q[a]) - f64::from(points[i][a]));
            let square: f64 = (0..3).map(|a| aspect[a] * aspect[a] * (step[a] * step[a])).sum();
            if square <= query.reach * query.reach {
                all.push(((square as f32).to_bits(), j, step));
            }
        }
        all.sort_by_key(|n| (n.0, n.1));
        all.truncate(query.count);
        all.sort_by_key(|n| n.1);
        all.into_iter().map(|n| n.2).collect()
    }

    fn agree(points: &[[u32; 3]], scale: [f64; 3], count: usize, reach: f64) {
        let points = distinct(points);
        let query = Query { count, count_max: count, reach };
        let found = std::sync::Mutex::new(Vec::new());
        let index = KnnIndex::new(&points, scale);
        let places = index.map(
            &query,
            |_| true,
            |steps| {
                let mut found = found.lock().unwrap();
                found.push(steps.to_vec());
                Some(found.len() - 1)
            },
            usize::MAX,
        );
        let found = found.into_inner().unwrap();
        for (i, &place) in places.iter().enumerate() {
            assert_eq!(found[place], plain(&points, i, scale, &query), "{i}: {:?}", points[i]);
        }
    }

    /// Points of several densities: a cube, a sheet, a line, and a few strays anywhere.
    fn clouds() -> impl Strategy<Value = Vec<[u32; 3]>> {
        let at = |c: u32| (c..c + 40).prop_map(move |x| x);
        let cube = prop::collection::vec((at(1000), at(1000), at(1000)), 0..300);
        let sheet = prop::collection::vec((0u32..2000, 0u32..2000, Just(1u32 << 31)), 0..200);
        let line = prop::collection::vec((0u32..100_000, Just(7u32), Just(9u32)), 0..60);
        let stray = prop::collection::vec(any::<(u32, u32, u32)>(), 0..20);
        (cube, sheet, line, stray).prop_map(|(a, b, c, d)| {
            [a, b, c, d].concat().into_iter().map(|(x, y, z)| [x, y, z]).collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_search_agrees_with_brute_force(points in clouds(), count in 1usize..20, reach in prop::sample::select(vec![3.0, 50.0, 1e4, 1e10]), flat: bool) {
            agree(&points, if flat { [0.001, 0.001, 0.01] } else { [0.5; 3] }, count, reach);
        }
    }

    #[test]
    fn empty_clouds_and_lone_points_have_no_neighbours() {
        agree(&[], [1.0; 3], 12, 1e10);
        agree(&[[5, 6, 7]], [1.0; 3], 12, 1e10);
        agree(&[[0; 3], [u32::MAX; 3]], [1.0; 3], 12, 1e10);
    }

    #[test]
    fn neighbours_at_the_other_end_of_the_lattice_are_found() {
        let near = (0..8).map(|i| [0, 5, i]);
        let points: Vec<_> = near.chain([[u32::MAX, 5, 9], [u32::MAX - 90, 7, 7]]).collect();
        (1..10).for_each(|count| agree(&points, [0.5; 3], count, 1e10));
    }
}
