"""Who draws for OpenGL on this machine."""

from __future__ import annotations

from PySide6.QtGui import QOffscreenSurface, QOpenGLContext

#: What OpenGL implementations on the processor call themselves, in small letters, and the enumerator that asks for the name.
SOFTWARE, GL_RENDERER = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software"), 0x1F01


def has_gpu() -> bool:
    """Whether OpenGL draws on a GPU: not where it runs on the processor, or is not there at all."""
    surface, context = QOffscreenSurface(), QOpenGLContext()
    surface.create()
    if not (context.create() and context.makeCurrent(surface)):
        return False
    name = str(context.functions().glGetString(GL_RENDERER)).lower()
    context.doneCurrent()
    return not any(word in name for word in SOFTWARE)
