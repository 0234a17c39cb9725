//! Disjoint sets of numbers (union-find; Tarjan, "Efficiency of a Good But Not Linear Set Union Algorithm", 1975).

/// Sets of the numbers from 0 on, each alone at first.
#[derive(Debug, Clone)]
pub struct DisjointSets(Vec<usize>);

impl DisjointSets {
    /// Of so many numbers.
    pub fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The least number of a number's set.
    pub fn least(&mut self, mut number: usize) -> usize {
        while self.0[number] != number {
            self.0[number] = self.0[self.0[number]];
            number = self.0[number];
        }
        number
    }

    /// Makes the sets of two numbers one.
    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.least(a), self.least(b));
        self.0[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_joined_has_one_least_number() {
        let mut sets = DisjointSets::new(8);
        for (a, b) in [(6, 7), (3, 6), (1, 2), (7, 2)] {
            sets.join(a, b);
        }
        let least: Vec<usize> = (0..8).map(|n| sets.least(n)).collect();
        assert_eq!(least, [0, 1, 1, 1, 4, 5, 1, 1]);
    }
}
