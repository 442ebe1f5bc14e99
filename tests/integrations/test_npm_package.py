"""The npm package in an empty Vite project with three.js: `make web` runs it; npm must reach its registry."""

import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from commands import ran
from supersampler.integrations.web import THREE_VERSION, package_files, serving, write_site
from supersampler_export.shaders.folder import shader_files
from web_page import FolderFiles

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest_plugins = ["chromium_fixtures"]  # fixtures

TOOLS = ("vite@8", "typescript@5.9", "@types/three@0.187", "@webgpu/types@0.1")
INDEX = '<!doctype html><link rel="icon" href="data:,"><script type="module" src="/main.ts"></script>'
MAIN = """
import {
  Mesh, MeshBasicNodeMaterial, PerspectiveCamera, RenderPipeline, Scene, SphereGeometry, WebGPURenderer,
} from "three/webgpu";
import { mrt, output, pass, vec4, velocity } from "three/tsl";
import { Upscaler, haltonJitter } from "supersampler";
import files from "supersampler/models/taau";
import { supersampler } from "supersampler/three";

const renderer = new WebGPURenderer({ antialias: false });
renderer.setSize(128, 72);
document.body.append(renderer.domElement);
const scene = new Scene(), camera = new PerspectiveCamera(45, 16 / 9, 0.1, 10);
camera.position.z = 3;
scene.add(new Mesh(new SphereGeometry(), new MeshBasicNodeMaterial({ color: 0xff8000 })));
const scenePass = pass(scene, camera).setMRT(mrt({ output, velocity }));
scenePass.setResolutionScale(0.5);
const [beauty, depth, motion] = ["output", "depth", "velocity"].map((name) => scenePass.getTextureNode(name));
const node = supersampler(beauty, depth, motion, camera, { method: "taau" });
const renderPipeline = new RenderPipeline(renderer, vec4(node.rgb, beauty.a));
renderer.setAnimationLoop(() => renderPipeline.render());
await node.ready;
const displaySize = [64, 36] as const;
await Upscaler.load((renderer.backend as any).device, (name) => files[name], { displaySize });
if (haltonJitter(0, 2).length === 2) document.title = "ready";
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the packed package, installed as from the registry."""
    if shutil.which("npm") is None:
        pytest.skip("npm is not installed here")
    folder = tmp_path_factory.mktemp("vite")
    write_site(folder / "package", package_files(["classifier", "taau"], shader_files))
    ran("npm", "pack", "./package", "--silent", folder=folder)
    (packed,) = folder.glob("supersampler-*.tgz")
    project = folder / "project"
    project.mkdir()
    (project / "package.json").write_text('{"private": true, "type": "module"}')
    (project / "index.html").write_text(INDEX)
    (project / "main.ts").write_text(MAIN)
    packages = (f"three@{THREE_VERSION}", *TOOLS, f"../{packed.name}")
    ran("npm", "install", "--silent", "--no-audit", "--no-fund", *packages, folder=project)
    return project


def check(browser: "Browser", address: str) -> None:
    """Open a page that must upscale, and say nothing."""
    page, said = browser.new_page(), []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(address)
    page.wait_for_function("document.title === 'ready'", timeout=600_000)
    page.close()
    assert not said


def test_types_are_those_that_the_compiler_expects(project: Path) -> None:
    options = "--noEmit --strict --skipLibCheck --target esnext --module esnext --moduleResolution bundler"
    types = ("--types", "@webgpu/types", "--lib", "esnext,dom")
    ran("npx", "tsc", *options.split(), *types, "main.ts", folder=project)


def test_a_built_page_upscales(project: Path, browser: "Browser") -> None:
    ran("npx", "vite", "build", "--base", "./", "--target", "esnext", folder=project)
    with serving(FolderFiles(project / "dist")) as url:
        check(browser, url)


def test_the_page_of_the_development_server_upscales(project: Path, browser: "Browser") -> None:
    command = ["npx", "vite", "--host", "127.0.0.1", "--port", "0", "--clearScreen", "false"]
    with subprocess.Popen(command, cwd=project, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        lines = iter(server.stdout.readline, "")
        line = next(line for line in lines if "http://" in line)
        check(browser, "http://" + line.split("http://")[1].split()[0])
        server.terminate()
