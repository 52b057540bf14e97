"""The rules in `tests/conftest.py` do what they say."""

from __future__ import annotations

import textwrap
from pathlib import Path

import platformdirs
import pytest

pytest_plugins = "pytester"
RULES = Path(__file__).resolve().parents[1] / "conftest.py"


class Suite:
    """A project with nothing but the rules of this one and the tests that are written into it."""

    def __init__(self, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
        self.pytester = pytester
        monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")  # what is left behind is the same without a display
        monkeypatch.delenv("PYTHONPATH", raising=False)  # else it may show the project itself
        self.write("tests/conftest.py", RULES.read_text(encoding="utf-8"))

    def write(self, path: str, text: str) -> None:
        file = self.pytester.path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(textwrap.dedent(text), encoding="utf-8")

    def run(self) -> pytest.RunResult:
        return self.pytester.runpytest_subprocess("-p", "no:cacheprovider", "-o", "qt_api=pyside6", "-o", "pythonpath=.")


@pytest.fixture
def suite(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Suite:
    return Suite(pytester, monkeypatch)


def test_settings_are_not_the_users(own_folders):
    for folder in (platformdirs.user_config_dir("degense"), platformdirs.user_cache_dir("degense"), platformdirs.user_log_dir("degense")):
        assert Path(folder).is_relative_to(own_folders)


def test_only_allowed_skips(suite):
    suite.write(
        "tests/test_skips.py",
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
        """,
    )
    suite.run().assert_outcomes(skipped=1, failed=2, errors=1, xfailed=1)


def test_a_module_that_skips_itself_fails(suite):
    suite.write("tests/test_nothing.py", "import pytest; pytest.importorskip('no_such_module')")
    suite.run().assert_outcomes(errors=1)


def test_nothing_of_qt_is_left_behind(suite):
    suite.write(
        "tests/widgets/test_leaks.py",
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
        """,
    )
    result = suite.run()
    result.assert_outcomes(passed=5, errors=3)
    result.stdout.fnmatch_lines(["*left behind: QWidget*", "*left behind: QTimer*", "*left behind: QThread*"])


def test_stated_shapes_are_checked(suite):
    (suite.pytester.path / "degense").mkdir()
    (suite.pytester.path / "degense" / "engine").symlink_to("../engine")
    suite.write("engine/plain.py", "def twice(x: int): return 2 * x")
    suite.write(
        "engine/shaped.py",
        """
        from __future__ import annotations

        import numpy as np
        from jaxtyping import Float

        def dot(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
            return float(a @ b[: len(a)])
        """,
    )
    suite.write(
        "tests/test_shapes.py",
        """
        import numpy as np
        from degense.engine import plain, shaped

        def test_right(): assert shaped.dot(np.ones(3), np.ones(3)) == 3
        def test_wrong(): shaped.dot(np.ones(3), np.ones(4))
        def test_not_stated(): assert plain.twice("a") == "aa"
        """,
    )
    result = suite.run()
    result.assert_outcomes(passed=2, failed=1)
    result.stdout.fnmatch_lines(["*whilst typechecking parameter 'b'*"])
