"""What pyproject.toml cannot say: a wheel has the folder setups/ as discsim/setups/."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["discsim", "discsim.*"]), "discsim.setups"],
    package_dir={"discsim.setups": "setups"},
    package_data={"discsim.setups": ["*.toml"]},
)
