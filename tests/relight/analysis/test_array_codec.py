import numpy as np

from relight.analysis.array_codec import compress, decompress


def test_equal_arrays_are_equal_bytes():
    """Machines that share a shot compare the files; with several threads Blosc's blocks come in any order."""
    noise = np.random.default_rng(0).normal(128, 20, (16, 40706)).clip(0, 255).astype(np.uint8)
    files = {compress(noise).tobytes() for _ in range(12)}
    assert len(files) == 1
    np.testing.assert_array_equal(decompress(np.frombuffer(files.pop(), np.uint8), "u1", noise.shape), noise)
