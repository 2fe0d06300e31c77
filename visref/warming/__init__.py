"""Compiling ahead what runs need: small jobs that meet the kernels, and what is known of them."""

from visref.warming.bytecode import keep_loaded, keep_packages
from visref.warming.parts import PARTS
from visref.warming.record import can_keep, holds, place, write_record

__all__ = ["PARTS", "can_keep", "holds", "keep_loaded", "keep_packages", "place", "write_record"]
