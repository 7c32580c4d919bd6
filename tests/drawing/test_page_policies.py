"""Every page that is written forbids what is not its own."""

import ast
import hashlib
import re
from base64 import b64encode

from urbantwin.fidelity.report_html import html_document

from ..source_imports import MODULES


def test_a_page_allows_its_own_scripts_by_their_digest() -> None:
    page = html_document("A & B", ["<p>x</p>", "<script>let a = 1;\n</script>"], "p{}")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', page)[1]
    digest = b64encode(hashlib.sha256(b"let a = 1;\n").digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none';")
    assert "script-src 'none'" in html_document("A", ["<p>"], "")


def test_no_page_is_written_without_a_policy() -> None:
    for module in MODULES:
        text = module.read_text(encoding="utf-8")
        if "<!doctype html" in text.lower():
            texts = [
                node.value
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.Constant) and isinstance(node.value, str)
            ]
            assert any("Content-Security-Policy" in one for one in texts), module
