#!/usr/bin/env python3
"""What scikit-learn makes of a take, for tests/rivals.rs.

    amc2xyz --space body --asf 07.asf --fps 120 07_01.amc | python3 make.py

Every coordinate gets a little noise that needs no generator (so that no variance is zero). Centimeters.
"""
import csv, math, sys
from pathlib import Path
import numpy as np
import sklearn
from sklearn.decomposition import PCA, FactorAnalysis
from sklearn.mixture import GaussianMixture

RIDGE = 1e-3 * (2.54 / 0.45) ** 2
rows = list(csv.reader(sys.stdin))
columns = [i for i, n in enumerate(rows[0]) if n[-2:] in (".x", ".y", ".z")]
x = np.array([[float(r[i]) for i in columns] for r in rows[1:]])
noise = np.array([[math.sin(t * 12.9898 + c * 78.233 + t * c * 0.37) for c in range(x.shape[1])] for t in range(len(x))])
x = (x + noise).astype(np.float32).astype(float)
out = Path(__file__).parent


def save(name, rows):
    text = "\n".join(",".join(f"{v:.9g}" for v in r) for r in rows)
    (out / name).write_text(text + "\n")


pca = PCA(n_components=0.9, svd_solver="full").fit(x)
# Rows: the variance (divided by n, as ours), then the component's coordinates.
save("pca.csv", [[v * (len(x) - 1) / len(x), *c] for v, c in zip(pca.explained_variance_, pca.components_)])

# From the take's quarters, in time.
labels = np.arange(len(x)) * 4 // len(x)
parts = [x[labels == j] for j in range(4)]
covs = [np.cov(p.T, bias=True) + RIDGE * np.eye(x.shape[1]) for p in parts]
gmm = GaussianMixture(4, reg_covar=RIDGE, max_iter=200, tol=1e-6, weights_init=[len(p) / len(x) for p in parts],
                      means_init=[p.mean(0) for p in parts], precisions_init=[np.linalg.inv(c) for c in covs]).fit(x)
save("mixture.csv", [[gmm.score(x)]])

fa = FactorAnalysis(10, tol=1e-6, max_iter=5000, svd_method="lapack").fit(x)
save("factors.csv", [[fa.score(x)]])
print("scikit-learn", sklearn.__version__, len(pca.components_), gmm.score(x), gmm.n_iter_, fa.score(x), file=sys.stderr)
