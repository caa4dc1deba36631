// Lightmaps of a baked GLB for three.js: loads the pages that asset.extras.lumel lists and puts them on the nodes' materials.
//
//     const gltf = await new GLTFLoader().loadAsync("room.glb");
//     await applyLightmaps(gltf, "");
//
// What is shown is albedo * E / pi plus the material's own emission. MeshStandardMaterial takes off what its dielectric coat
// reflects, 2 to 5 % (RE_IndirectDiffuse_Physical); with `diffuse` (the default) materials become MeshLambertMaterials, which don't.

import * as THREE from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";
import { HDRLoader } from "three/addons/loaders/HDRLoader.js";
import { KTX2Loader } from "three/addons/loaders/KTX2Loader.js";

// Factor from a texel to the irradiance that `material.lightMap` is.
const INTENSITY = { outgoing: Math.PI, irradiance: 1 };

/** Loads the page `uri`; `turned`: row 0 lies at the bottom, as these loaders put it for EXR and HDR. */
async function loadPage(uri, base, renderer) {
  const url = base + uri.split("/").map(encodeURIComponent).join("/");
  const end = uri.slice(uri.lastIndexOf("."));
  const loaders = {
    ".exr": () => new EXRLoader().setDataType(THREE.FloatType),
    ".hdr": () => new HDRLoader().setDataType(THREE.FloatType),
    ".ktx2": () => new KTX2Loader().detectSupport(renderer),
  };
  if (!loaders[end]) throw new Error(`${uri}: three.js has no loader for this form; bake with --encoding exr, hdr or ktx2-half`);
  const texture = await loaders[end]().loadAsync(url);
  texture.colorSpace = THREE.NoColorSpace;
  texture.minFilter = texture.mipmaps?.length > 1 ? THREE.LinearMipmapLinearFilter : THREE.LinearFilter;
  texture.magFilter = THREE.LinearFilter;
  texture.generateMipmaps = false;
  return { texture, turned: end !== ".ktx2" };
}

/** The texture with a surface's rectangle; those of one page share their picture. */
function placed({ texture, turned }, { texCoord, scale, offset }) {
  const own = texture.clone();
  own.channel = texCoord;
  own.repeat.set(scale[0], turned ? -scale[1] : scale[1]);
  own.offset.set(offset[0], turned ? 1 - offset[1] : offset[1]);
  return own;
}

/** A MeshLambertMaterial that looks like `material` where it is diffuse. */
function lambert(material) {
  const own = new THREE.MeshLambertMaterial();
  for (const key of [
    "name", "map", "alphaMap", "emissiveMap", "emissiveIntensity", "opacity", "transparent", "alphaTest", "side", "vertexColors", "depthWrite",
  ]) {
    if (material[key] !== undefined) own[key] = material[key];
  }
  own.color.copy(material.color);
  if (material.emissive) own.emissive.copy(material.emissive);
  return own;
}

/** The meshes that draw a node itself, not its children. */
function meshesOf(gltf, object) {
  if (object.isMesh) return [object];
  const own = gltf.parser.associations.get(object)?.nodes;
  const isOwn = (child) => child.isMesh && [undefined, own].includes(gltf.parser.associations.get(child)?.nodes);
  return object.children.filter(isOwn);
}

/**
 * Puts the lightmaps of a baked GLB on its materials; `base` is the URL of its folder, with a slash at its end or empty.
 * Options: `renderer` for KTX2 pages, `diffuse` (default true), `encoding` to choose among several forms of the pages.
 * Returns the number of meshes that have one.
 */
export async function applyLightmaps(gltf, base, { renderer, diffuse = true, encoding } = {}) {
  const lumel = gltf.asset.extras?.lumel;
  if (!lumel?.pages?.length) throw new Error("asset.extras.lumel lists no pages; is this a baked file?");
  const intensity = INTENSITY[lumel.quantity];
  if (!intensity) throw new Error(`a lightmap of ${lumel.quantity} holds the albedo already; bake with --for three`);
  const named = encoding === undefined ? (e) => e.uris[0] === lumel.pages[0].uri : (e) => e.name === encoding;
  const form = lumel.encodings?.find(named);
  const uris = form ? form.uris : lumel.pages.map((p) => p.uri);
  const pages = await Promise.all(uris.map((uri) => loadPage(uri, base, renderer)));
  let count = 0;
  gltf.scene.traverse((object) => {
    const place = object.userData.lumel;
    if (place?.page === undefined) return;
    const texture = placed(pages[place.page], place);
    for (const mesh of meshesOf(gltf, object)) {
      mesh.material = diffuse && mesh.material.color ? lambert(mesh.material) : mesh.material.clone();
      mesh.material.lightMap = texture;
      mesh.material.lightMapIntensity = intensity * (form?.scale ?? 1);
      count += 1;
    }
  });
  return count;
}
