"""`python -m tests.bill SBOM`: into a bill of materials, CycloneDX, what lies in our own package and nobody installs."""

import hashlib
import json
import re
import sys
from pathlib import Path
from typing import Any

VENDOR = Path(__file__).parent.parent / "estimator/web/static/vendor"
_HEAD = re.compile(r"/\*! (?P<url>https://\S+/(?P<name>\w+)) \(v(?P<version>[\d.]+)\)")


def vendored() -> list[dict[str, Any]]:
    """Each script by its own first line, with the hash of what is there."""
    return [_component(path) for path in sorted(VENDOR.glob("*.js"))]


def _component(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    said = _HEAD.match(content[:200].decode())
    if said is None:
        raise ValueError(f"{path}: its first line does not say what it is, and of which version")
    name, version, url = said["name"], said["version"], said["url"]
    return {
        "type": "library",
        "bom-ref": f"vendored-{name}",
        "name": name,
        "version": version,
        "purl": f"pkg:npm/{name.lower()}@{version}",
        "licenses": [{"license": {"id": "MIT"}}],
        "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(content).hexdigest()}],
        "externalReferences": [{"type": "vcs", "url": url}],
    }


def main(bill: Path) -> None:
    """Add them; a second time changes nothing."""
    said = json.loads(bill.read_text("utf-8"))
    ours = vendored()
    names = {one["bom-ref"] for one in ours}
    said["components"] = [one for one in said["components"] if one["bom-ref"] not in names] + ours
    bill.write_text(json.dumps(said, indent=2) + "\n", "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
