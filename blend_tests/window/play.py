"""Started by Blender, with its window: `blender --python play.py -- NAME SCENARIO FOLDER`."""

import importlib.util
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from driver import Driver  # noqa: E402

name, scenario, folder = sys.argv[sys.argv.index("--") + 1 :]
scenario, folder = Path(scenario), Path(folder)
spec = importlib.util.spec_from_file_location(scenario.stem, scenario)
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
Driver(name, folder).start(module.play)
