"""Maps the repository root to the package `kfmocap`: pip sees the same tree that Blender sees."""

from setuptools import find_packages, setup

# Of the beam, the footage is fetched and stays out.
EXAMPLES = ["examples/walk/**/*", "examples/beam/*.t*", "examples/beam/*.json", "examples/beam/SHA256SUMS"]
PARTS = ["benchmarks", "benchmarks.*", "cli", "core", "core.*", "kfmocap_addon", "kfmocap_addon.*"]

setup(
    script_name="setup.py",  # keeps this file out of the package, beside which it lies
    package_dir={"kfmocap": "."},
    packages=["kfmocap"] + [f"kfmocap.{name}" for name in find_packages(".", include=PARTS)],
    include_package_data=False,
    package_data={"kfmocap": ["blender_manifest.toml", *EXAMPLES]},
)
