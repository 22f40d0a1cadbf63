//! Strongly connected components of a directed graph.

use std::collections::{BTreeMap, BTreeSet};

/// Edges by their source.
pub type Edges = BTreeMap<usize, BTreeSet<usize>>;

/// Groups of two or more nodes that all reach each other, in order of their first nodes.
pub fn circles(edges: &Edges) -> Vec<BTreeSet<usize>> {
    let reached: BTreeMap<usize, BTreeSet<usize>> =
        edges.keys().map(|node| (*node, reached_from(edges, *node))).collect();
    let reaches = |a: usize, b: usize| reached.get(&a).is_some_and(|nodes| nodes.contains(&b));
    let mut circles: Vec<BTreeSet<usize>> = Vec::new();
    for node in edges.keys() {
        if circles.iter().any(|circle| circle.contains(node)) {
            continue;
        }
        let mates = reached[node].iter().copied().filter(|other| reaches(*other, *node));
        let circle: BTreeSet<usize> = mates.chain([*node]).collect();
        if circle.len() > 1 {
            circles.push(circle);
        }
    }
    circles
}

/// Nodes that a path of one or more edges leads to.
fn reached_from(edges: &Edges, node: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![node];
    while let Some(next) = open.pop() {
        open.extend(edges.get(&next).into_iter().flatten().filter(|n| reached.insert(**n)));
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_are_found_apart_from_what_leads_to_them() {
        let edges = |pairs: &[(usize, usize)]| {
            let mut edges = Edges::new();
            for (a, b) in pairs {
                edges.entry(*a).or_default().insert(*b);
            }
            edges
        };
        assert!(circles(&edges(&[(0, 1), (1, 2), (0, 2)])).is_empty());
        let found = circles(&edges(&[(0, 1), (1, 2), (2, 1), (2, 3), (4, 5), (5, 6), (6, 4)]));
        assert_eq!(found, [BTreeSet::from([1, 2]), BTreeSet::from([4, 5, 6])]);
    }
}
