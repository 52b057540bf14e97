"""The folders app, engine, widgets and assets are installed as one package, `degense` (decision 29); the rest is in pyproject.toml."""

from setuptools import find_namespace_packages, setup

FOLDERS = ("app", "engine", "widgets", "assets")
GUIDE = ("degense.docs.guide", "degense.docs.guide.images")  # the user guide, which the window shows

setup(
    packages=[
        *(f"degense.{name}" for folder in FOLDERS for name in (folder, *(f"{folder}.{sub}" for sub in find_namespace_packages(folder)))),
        *GUIDE,
    ],
    package_dir={f"degense.{folder}": folder for folder in FOLDERS}
    | {name: name.removeprefix("degense.").replace(".", "/") for name in GUIDE},
)
