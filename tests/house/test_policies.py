"""The rules in `tests/conftest.py` do what they say."""

from __future__ import annotations

from pathlib import Path

import platformdirs
import pytest

pytest_plugins = "pytester"
RULES = Path(__file__).resolve().parents[1] / "conftest.py"


@pytest.fixture
def suite(pytester: pytest.Pytester) -> pytest.Pytester:
    """An empty suite of tests under the rules of this one."""
    pytester.makeconftest(RULES.read_text(encoding="utf-8"))
    return pytester


def test_settings_are_not_the_users(own_folders):
    for folder in (platformdirs.user_config_dir("degense"), platformdirs.user_cache_dir("degense"), platformdirs.user_log_dir("degense")):
        assert Path(folder).is_relative_to(own_folders)


def test_only_allowed_skips(suite):
    suite.makepyfile(
        """
        import pytest
        @pytest.mark.skip("needs CUDA")
        def test_allowed(): pass
        @pytest.mark.skip("too slow today")
        def test_refused(): pass
        def test_refused_inside(): pytest.skip("perhaps later")
        def test_refused_import(): pytest.importorskip("no_such_module")
        @pytest.mark.xfail(strict=True)
        def test_known_defect(): assert False
        """
    )
    suite.runpytest_subprocess("-p", "no:cacheprovider").assert_outcomes(skipped=1, failed=2, errors=1, xfailed=1)


def test_a_module_that_skips_itself_fails(suite):
    suite.makepyfile("import pytest; pytest.importorskip('no_such_module')")
    suite.runpytest_subprocess("-p", "no:cacheprovider").assert_outcomes(errors=1)


def test_nothing_of_qt_is_left_behind(suite):
    (suite.path / "widgets").mkdir()
    (suite.path / "widgets" / "test_leaks.py").write_text(
        """
from PySide6.QtCore import QThread, QTimer
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget
kept = []
def keep(thing):
    kept.append(thing)
    return thing

def test_clean(qtbot):
    widget = QWidget()
    QVBoxLayout(widget).addWidget(QLabel("x"))
    qtbot.addWidget(widget)
    QTimer(widget).start(5)
    widget.show()
def test_window(qapp): keep(QWidget())
def test_timer(qapp): keep(QTimer()).start(50)
def test_thread(qapp): keep(QThread()).start()
def test_last(qapp):
    kept[-1].quit()
    kept[-1].wait()
"""
    )
    result = suite.runpytest_subprocess("-p", "no:cacheprovider", "-o", "qt_api=pyside6")
    result.assert_outcomes(passed=5, errors=3)
    result.stdout.fnmatch_lines(["*left behind: QWidget*", "*left behind: QTimer*", "*left behind: QThread*"])
