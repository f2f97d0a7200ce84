"""Writes what linking for macOS needs of Apple's libraries, into a folder that SDKROOT can name: for each, where it
lies on a Mac, and those of its symbols that Relume's dependencies use (Apple's developer documentation names the
framework of each). The rest of macOS, `libSystem`, comes with zig. Usage: apple_stubs.py FOLDER
"""

import sys
from pathlib import Path

FRAMEWORKS = {
    "CoreFoundation.framework/Versions/A/CoreFoundation": "CFRelease",
    "CoreGraphics.framework/Versions/A/CoreGraphics": """
        CGColorSpaceCreateWithName kCGColorSpaceDisplayP3 kCGColorSpaceExtendedLinearSRGB kCGColorSpaceExtendedSRGB""",
    "Foundation.framework/Versions/C/Foundation": "NSKeyValueChangeNewKey",
    "Metal.framework/Versions/A/Metal": "MTLCopyAllDevices",
    "QuartzCore.framework/Versions/A/QuartzCore": "",
}
OBJECTIVE_C = """
    class_addIvar class_addMethod class_getInstanceVariable class_getName class_isMetaClass class_respondsToSelector
    ivar_getOffset objc_alloc objc_allocateClassPair objc_autoreleasePoolPop objc_autoreleasePoolPush objc_destroyWeak
    objc_disposeClassPair objc_getClass objc_initWeak objc_loadWeakRetained objc_msgSend objc_msgSendSuper
    objc_registerClassPair objc_release objc_retain objc_retainAutoreleasedReturnValue object_getClass sel_getName
    sel_registerName"""
INTEL_ONLY = "objc_msgSend_stret"
"""For results that are returned in memory, as Intel's processors do it."""

# Apple's text-based stubs, version 4; LLVM's `TextStub.cpp` reads them.
STUB = """--- !tapi-tbd
tbd-version: 4
targets: [ arm64-macos, x86_64-macos ]
install-name: '{library}'
exports:
  - targets: [ arm64-macos, x86_64-macos ]
    symbols: [ {symbols} ]
  - targets: [ x86_64-macos ]
    symbols: [ {intel_only} ]
...
"""


def write(path, library, names, intel_only=""):
    """A stub of one library."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(STUB.format(library=library, symbols=symbols(names), intel_only=symbols(intel_only)))


def symbols(names):
    """C's names begin with an underscore in object files."""
    return ", ".join(f"_{name}" for name in names.split())


def main():
    (root,) = map(Path, sys.argv[1:])
    folder = "System/Library/Frameworks"
    for library, names in FRAMEWORKS.items():
        framework, name = library.split("/")[0], library.split("/")[-1]
        write(root / folder / framework / f"{name}.tbd", f"/{folder}/{library}", names)
    write(root / "usr/lib/libobjc.tbd", "/usr/lib/libobjc.A.dylib", OBJECTIVE_C, INTEL_ONLY)


if __name__ == "__main__":
    main()
