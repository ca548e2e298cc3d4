//! Sparse coding: pursuit, K-SVD and dictionaries.
