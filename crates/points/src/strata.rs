//! Levels and strata: the possible lengths of a node's prefix. A level of `n` points is divided
//! into 16 strata; stratum `s` holds the points whose index in the level's Morton order is
//! congruent to the bit-reversed `s` modulo 16, so its size follows from `n` alone. Prefixes are
//! whole strata.

/// Strata of a level.
pub const STRATA: usize = 16;

/// Residue modulo [`STRATA`] of the points in stratum `s`: `s` with its four bits reversed.
pub const fn residue(s: usize) -> usize {
    ((s & 1) << 3) | ((s & 2) << 1) | ((s & 4) >> 1) | ((s & 8) >> 3)
}

/// Number of points of stratum `s` in a level of `n` points.
pub const fn stratum_len(n: usize, s: usize) -> usize {
    (n + STRATA - 1 - residue(s)) / STRATA
}

/// The smallest prefix of whole strata with at least `wanted` points; all points if there are
/// fewer. `levels` are the counts of the node's levels.
pub fn prefix_at_least(levels: impl IntoIterator<Item = usize>, wanted: usize) -> usize {
    let mut have = 0;
    if wanted == 0 {
        return 0;
    }
    for n in levels {
        if have + n < wanted {
            have += n;
            continue;
        }
        for s in 0..STRATA {
            have += stratum_len(n, s);
            if have >= wanted {
                return have;
            }
        }
    }
    have
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strata_of_a_level_add_up_and_match_their_residues() {
        for n in 0..200 {
            let sizes: Vec<_> = (0..STRATA).map(|s| stratum_len(n, s)).collect();
            assert_eq!(sizes.iter().sum::<usize>(), n);
            for (s, &size) in sizes.iter().enumerate() {
                assert_eq!(size, (0..n).filter(|i| i % STRATA == residue(s)).count());
            }
        }
    }

    #[test]
    fn prefixes_are_the_smallest_whole_strata() {
        let levels = [40usize, 160, 641];
        let mut boundaries = vec![0];
        for n in levels {
            for s in 0..STRATA {
                boundaries.push(boundaries.last().unwrap() + stratum_len(n, s));
            }
        }
        for wanted in 0..900 {
            let expect = boundaries.iter().copied().find(|&b| b >= wanted).unwrap_or(841);
            assert_eq!(prefix_at_least(levels, wanted), expect, "{wanted}");
        }
    }
}
