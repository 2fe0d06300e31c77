"""What a result was made with: the versions that it leans on, code by digest, and the machine."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PACKAGES = ("numpy", "numba", "embreex", "open3d-cpu", "moderngl", "trimesh", "pyarrow")
# What is imported of a package; its data files are its own affair.
_CODE = (".py", ".so", ".pyd")


def versions() -> dict[str, str]:
    """visref, Python, and the libraries that a verdict leans on."""
    found = {"visref": version("visref"), "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def code_of(package: str) -> str:
    """A digest of a package's code, or of a module's, without importing it; empty where there is
    none. One in the current folder is found too."""
    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError, AttributeError):
        return ""
    finally:
        sys.path.remove(here)
    if spec is None:
        return ""
    roots = list(spec.submodule_search_locations or ())
    if not roots:
        return "" if spec.origin is None else file_digest(Path(spec.origin))
    digest = hashlib.sha256()
    for root in roots:
        files = (file for file in Path(root).rglob("*") if file.suffix in _CODE)
        for name, file in sorted((file.relative_to(root).as_posix(), file) for file in files):
            digest.update(f"{name}\0{file_digest(file)}\n".encode())
    return digest.hexdigest()


def file_digest(file: Path) -> str:
    """SHA-256 of a file, in hexadecimal; empty where it cannot be read, which its reader says."""
    try:
        with file.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError:
        return ""


def machine() -> dict[str, Any]:
    """The machine: `cpu` and `system` in words, `cores` (logical ones)."""
    model = platform.processor() or platform.machine()
    try:
        for line in (
            Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        ):
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    return {"cpu": model, "cores": os.cpu_count(), "system": platform.platform()}
