"""posing beside its peers, on the same poses, dictionaries and threads: `make bench-peers`.

    peers.py POSING_BIN CMU_FOLDER [--quick] [coding | training | clustering | tables]...

Our figures are of whole processes, reading and writing included (coding is less a process that codes one pose); the peers'
are of the call alone, inside this process, with everything in memory. Runs alternate where there are several, and then figures are medians; dictionaries are learned once.
Both have two threads. "agree" says whether the results are as good: an error
(mean square a coordinate), an inertia, or equal numbers.
"""
import csv
import io
import os

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ[library + "_NUM_THREADS"] = "2"

import subprocess
import sys
import tempfile
import time
import warnings

import numpy as np
import pyarrow
import pyarrow.csv
import spams
from sklearn.cluster import KMeans
from sklearn.decomposition import MiniBatchDictionaryLearning
from sklearn.linear_model import orthogonal_mp_gram

BIN, CMU = sys.argv[1:3]
QUICK = "--quick" in sys.argv
THREADS = "2"
missed = []


def posing(name, *args, **more):
    return subprocess.run([os.path.join(BIN, name), "-q", "--threads", THREADS, *map(str, args)], check=True, stdout=subprocess.PIPE, **more).stdout


def timed(work):
    began = time.perf_counter()
    result = work()
    return time.perf_counter() - began, result


def paired(ours, theirs, runs):
    """Median seconds of each, run in turn, and what each answered last."""
    a, b = [], []
    for _ in range(1 if QUICK else runs):
        seconds, our = timed(ours)
        a.append(seconds)
        seconds, their = timed(theirs)
        b.append(seconds)
    return np.median(a), our, np.median(b), their


def line(what, ours, theirs, asked, agree, good):
    """`asked`: how many times as fast as the peer we should be."""
    ratio = theirs / max(ours, 1e-9)
    verdict = "" if ratio >= asked and good else "  SHORT"
    if verdict:
        missed.append(what)
    print(f"{what:<52} {ours:>9.4g} {theirs:>9.4g} {ratio:>7.2f} {asked:>6.4g}  {agree}{verdict}", flush=True)


def title(name):
    print(f"\n{name:<52} {'posing s':>9} {'peer s':>9} {'times':>7} {'asked':>6}  agree")


def poses(work):
    """All takes of subject 01 in body space, (frames, 69), and their tables as files."""
    folder = os.path.join(CMU, "01")
    takes = sorted(os.path.join(folder, f) for f in os.listdir(folder) if f.endswith(".amc"))
    args = ["--fps", 120, "--space", "body", "--asf", os.path.join(folder, "01.asf"), *takes]
    for ending in ("csv", "npy"):
        posing("amc2xyz", "-o", os.path.join(work, "all." + ending), *args)
    return np.load(os.path.join(work, "all.npy")).astype(np.float32), takes


def error(poses, atoms, codes):
    return float(((poses - (atoms.T @ codes).T) ** 2).mean())


def spams_omp(poses, atoms):
    # Without an eps it takes whatever stands in its place, and now and then codes nothing.
    return spams.omp(np.asfortranarray(poses.T), np.asfortranarray(atoms.T), L=3, eps=0.0, return_reg_path=False, numThreads=int(THREADS))


def coding(Y, order, work):
    title("coding: optimized OMP, 3 atoms a pose")
    for n, asked, m in ((1000, 3, 20000), (5000, 6, 20000), (20000, 20, 6000)):
        m = 1000 if QUICK else m
        atoms, queries = Y[order[:n]], Y[order[-m:]]
        atoms = atoms / np.linalg.norm(atoms, axis=1, keepdims=True)
        model, start, file, one = (os.path.join(work, f) for f in ("m.npz", "start.npy", "q.npy", "one.npy"))
        np.save(start, atoms * 100)
        np.save(file, queries)
        posing("ksvd-train", "-n", n, "--space", "body", "--init", start, "--iterations", 0, "-o", model, start)
        np.save(one, queries[:1])
        encode = lambda poses: posing("encode", "-m", model, "--sparsity", 3, poses)
        ours, text, theirs, codes = paired(lambda: encode(file), lambda: spams_omp(queries, atoms), 5)
        begun = np.median([timed(lambda: encode(one))[0] for _ in range(5)])
        assert ours > 1.2 * begun or QUICK, "too few poses to tell coding from the start of a process"
        ours = max(ours - begun, 0.1 * ours)
        rms = np.array([float(r["rms"]) for r in csv.DictReader(io.StringIO(text.decode()))])
        mine, other = float((rms**2).mean()), error(queries, atoms, codes)
        line(f"{n} atoms, {m} poses: SPAMS omp", ours, theirs, asked, f"{mine:.4g} {other:.4g}", mine <= 1.001 * other)
        if n == 1000:
            few = queries[:1000].astype(np.float64)
            gram, products = atoms @ atoms.T, atoms @ few.T
            scikit = lambda: orthogonal_mp_gram(gram.astype(np.float64), products, n_nonzero_coefs=3)
            theirs, codes = timed(scikit)
            other = error(few, atoms, codes)
            mine = float((rms[:1000] ** 2).mean())
            line(f"{n} atoms, a pose: scikit-learn orthogonal_mp_gram", ours / m, theirs / len(few), 100, f"{mine:.4g} {other:.4g}", mine <= other)


def training(Y, order, work):
    """Each peer's setting is a point of error and seconds: we are to be below it in both."""
    title("learning a dictionary, 3 atoms a pose; error unseen")
    half = len(Y) // 2
    learned, unseen = Y[order[:half]].copy(), Y[order[half:]][:5000].copy()
    file, model = os.path.join(work, "t.npy"), os.path.join(work, "t.npz")
    np.save(file, learned)

    def judged(atoms):
        atoms = np.ascontiguousarray(atoms / np.linalg.norm(atoms, axis=1, keepdims=True).clip(1e-9), dtype=np.float32)
        return error(unseen, atoms, spams_omp(unseen, atoms))

    def ours(n, iterations):
        train = lambda: posing("ksvd-train", "-n", n, "--space", "body", "--coherence", 0.99, "--iterations", iterations, "-o", model, file)
        seconds = timed(train)[0]
        return seconds, judged(np.load(model)["atoms"])

    def trained_by_spams(n, iterations):
        columns = np.asfortranarray(learned.T)
        learn = lambda: spams.trainDL(columns, K=n, lambda1=3, mode=3, iter=iterations, batchsize=512, numThreads=int(THREADS), verbose=False)
        seconds, atoms = timed(learn)
        return seconds, judged(atoms.T)

    def trained_by_scikit(n):
        learner = MiniBatchDictionaryLearning(n, alpha=30, max_iter=1, batch_size=256, fit_algorithm="cd", transform_max_iter=200, random_state=0)
        seconds, _ = timed(lambda: learner.fit(learned))
        return seconds, judged(learner.components_)

    for n in (500, 1000):
        points = [ours(n, i) for i in ((2, 5) if QUICK else (1, 2, 5, 10, 20, 40))]
        print("   posing: " + ", ".join(f"{s:.2f} s {e:.4g}" for s, e in points))
        peers = [(f"SPAMS trainDL, {i} batches", trained_by_spams(n, i)) for i in ((100,) if QUICK else (100, 300, 1000, 3000))]
        peers += [] if QUICK else [("scikit-learn MiniBatchDictionaryLearning", trained_by_scikit(n))]
        for name, (seconds, err) in peers:
            # The first of our points that errs less than the peer.
            found = next((p for p in points if p[1] < err), points[-1])
            line(f"{n} atoms: {name}", found[0], seconds, 1, f"{found[1]:.4g} {err:.4g}", found[1] < err)


def inertia(poses, centers):
    sums = 0.0
    for i in range(0, len(poses), 4096):
        x = poses[i : i + 4096].astype(np.float64)
        far = (x**2).sum(1)[:, None] - 2 * x @ centers.T + (centers**2).sum(1)
        sums += far.min(1).clip(0).sum()
    return sums


def clustering(Y, work):
    title("k-means, medians of some seeds; inertia")
    file, model = os.path.join(work, "k.npy"), os.path.join(work, "k.npz")
    np.save(file, Y)
    # Inertias of few clusters differ by more between seeds (0.4%) than between programs: many seeds tell them apart.
    for k, seeds in ((200, 21), (2000, 5)):
        for algorithm in ("lloyd", "elkan"):
            mine, other = [], []
            for seed in range(1 if QUICK else seeds):
                cluster = lambda: posing("cluster", "-k", k, "--seed", seed, "--save", model, "-o", os.path.join(work, "k2.csv"), file)
                mine.append((timed(cluster)[0], inertia(Y, np.load(model)["centroids"].astype(np.float64))))
                seconds, fit = timed(lambda: KMeans(k, n_init=1, algorithm=algorithm, random_state=seed).fit(Y))
                other.append((seconds, inertia(Y, fit.cluster_centers_.astype(np.float64))))
            (a, ours), (b, theirs) = np.median(mine, axis=0), np.median(other, axis=0)
            line(f"k = {k}, {len(mine)} seeds: scikit-learn, {algorithm}", a, b, 2, f"{ours:.5g} {theirs:.5g}", ours <= theirs)


def tables(takes, work):
    title("reading and writing tables")
    at = lambda name: os.path.join(work, name)
    # A table long enough that a process's start does not count: all takes, several times.
    numbers = np.load(at("all.npy"))
    numbers = np.concatenate([numbers] * (1 if QUICK else 4))
    np.save(at("big.npy"), numbers)
    posing("corrupt", "--dense", 0, "--to", "csv", "-o", at("big.csv"), at("big.npy"))
    megabytes = lambda name: os.path.getsize(at(name)) / 1e6
    read = lambda: posing("corrupt", "--dense", 0, "--to", "npy", "-o", at("x.npy"), at("big.csv"))
    ours, _, theirs, table = paired(read, lambda: pyarrow.csv.read_csv(at("big.csv")), 5)
    same = np.array_equal(np.load(at("x.npy")), numbers)
    line(f"CSV, {megabytes('big.csv'):.0f} MB, to NPY: pyarrow.csv.read_csv", ours, theirs, 1, "equal" if same else "differ", same)
    write = lambda: posing("corrupt", "--dense", 0, "--to", "csv", "-o", at("x.csv"), at("big.npy"))
    ours, _, theirs, _ = paired(write, lambda: pyarrow.csv.write_csv(table, at("y.csv")), 5)
    same = table.equals(pyarrow.csv.read_csv(at("x.csv")))
    line("NPY to CSV: pyarrow.csv.write_csv", ours, theirs, 1, "equal" if same else "differ", same)
    through = lambda: posing("corrupt", "--dense", 0, "--to", "npy", "-o", at("x.npy"), at("big.npy"))
    ours, _, theirs, _ = paired(through, lambda: np.save(at("y.npy"), np.load(at("big.npy"))), 5)
    same = np.array_equal(np.load(at("x.npy")), numbers)
    line("NPY to NPY: numpy.load, numpy.save", ours, theirs, 1 / 1.5, "equal" if same else "differ", same)
    amc = sum(map(os.path.getsize, takes)) / 1e6
    asf = os.path.join(CMU, "01", "01.asf")
    for to, asked in (("npy", 200), ("csv", 100)):
        convert = lambda: posing("amc2xyz", "--fps", 120, "--asf", asf, "--to", to, "-o", at("x." + to), *takes)
        ours = np.median([timed(convert)[0] for _ in range(5)])
        line(f"AMC to {to.upper()}, {amc / ours:.0f} MB/s: {asked} MB/s", ours, amc / asked, 1, "", True)


def main():
    warnings.filterwarnings("ignore")
    print(f"{THREADS} threads")
    # In memory, where there is such a folder: ours make sure that files are on the disk, the peers do not.
    memory = "/dev/shm" if os.path.isdir("/dev/shm") else None
    with tempfile.TemporaryDirectory(dir=memory) as work:
        Y, takes = poses(work)
        order = np.random.default_rng(0).permutation(len(Y))
        sections = {
            "coding": lambda: coding(Y, order, work),
            "training": lambda: training(Y, order, work),
            "clustering": lambda: clustering(Y, work),
            "tables": lambda: tables(takes, work),
        }
        for name in [a for a in sys.argv[3:] if a in sections] or sections:
            sections[name]()
    print("\nas asked" if not missed else f"\nshort: {len(missed)}")


main()
