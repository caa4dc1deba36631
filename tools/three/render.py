"""A baked GLB in three.js, in a headless Chromium: the linear picture of the file's own camera."""

import shutil
import subprocess
import sys
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote, urlencode, urlsplit

import numpy as np

HERE = Path(__file__).resolve().parent
MODULES = HERE.parent.parent / ".venv-three" / "node_modules" / "three"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# WebGL by software, alike on every machine; root may not have a sandbox.
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--no-first-run", "--disable-extensions", "--disable-background-networking", "--disable-component-update",
)  # fmt: skip


def browser() -> str | None:
    """The program of a Chromium, where there is one."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


class Handler(SimpleHTTPRequestHandler):
    """Serves this folder, three.js and the bake's folder, and takes the page's answer."""

    def __init__(self, *arguments, folder: Path, answer: dict, done: threading.Event, **options):
        self.folder, self.answer, self.done = folder, answer, done
        super().__init__(*arguments, **options)

    def translate_path(self, path: str) -> str:
        first, _, rest = super().translate_path(path).removeprefix(str(Path(self.directory).resolve()) + "/").partition("/")
        roots = {"page": HERE, "three": MODULES, "bake": self.folder}
        return str(roots[first] / rest) if first in roots else str(HERE / "missing")

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        url = urlsplit(self.path)
        self.answer[url.path.strip("/")] = (url.query, body)
        self.send_response(204)
        self.end_headers()
        self.done.set()

    def log_message(self, *_):
        pass


def render(glb: Path, width: int, height: int, samples: int = 4, timeout: float = 120, **options) -> np.ndarray:
    """Radiance (H, W, 3), row 0 at the top; `options`: `material` lambert or standard, `encoding` a form of the pages.

    Raises RuntimeError with what the page says where it fails.
    """
    answer, done = {}, threading.Event()
    with tempfile.TemporaryDirectory() as profile:
        handler = partial(Handler, directory=profile, folder=glb.parent, answer=answer, done=done)
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        query = urlencode({"glb": f"/bake/{quote(glb.name)}", "width": width, "height": height, "samples": samples, **options})
        url = f"http://127.0.0.1:{server.server_port}/page/render.html?{query}"
        command = [browser(), *FLAGS, f"--user-data-dir={profile}/profile", "--remote-debugging-port=0", url]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            arrived = done.wait(timeout)
        finally:
            process.terminate()
            complaint = process.communicate()[1].decode(errors="replace")
            server.shutdown()
            server.server_close()
    if "result" not in answer:
        said = answer["failure"][1].decode() if arrived else f"no answer within {timeout} s\n{complaint[-2000:]}"
        raise RuntimeError(f"{glb}: {said}")
    pixels = np.frombuffer(answer["result"][1], np.float32).reshape(height, samples, width, samples, 4)
    return pixels.mean((1, 3))[::-1, :, :3].astype(float)


if __name__ == "__main__":
    picture = render(Path(sys.argv[1]), 320, 240)
    print(picture.shape, picture.mean((0, 1)))
