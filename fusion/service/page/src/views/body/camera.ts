// Where the body is looked at from: an orthographic camera above a longitude and latitude.
import { OrthographicCamera, Vector3 } from "three";

const RAD = Math.PI / 180;

export interface Look {
  /** Degrees east, and north, of the middle of the picture. */
  longitude: number;
  latitude: number;
  /** Metres across the shorter side of the picture. */
  width: number;
}

/** Return the unit vector towards a longitude and latitude. */
export function towards(longitude: number, latitude: number): Vector3 {
  const [lon, lat] = [longitude * RAD, latitude * RAD];
  return new Vector3(Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat));
}

/** Return longitude (0 … 360) and latitude, degrees, of a point. */
export function lonLat(point: Vector3): [number, number] {
  const longitude = Math.atan2(point.y, point.x) / RAD;
  return [(longitude + 360) % 360, Math.atan2(point.z, Math.hypot(point.x, point.y)) / RAD];
}

/** Return a look with its angles in range and a width between 1/500 of and three times the body's. */
export function limited(look: Look, radius: number): Look {
  return {
    longitude: ((look.longitude % 360) + 360) % 360,
    latitude: Math.min(90, Math.max(-90, look.latitude)),
    width: Math.min(6 * radius, Math.max(radius / 250, look.width)),
  };
}

/** Return the look that a text "longitude,latitude,width" of the address means; null if none. */
export function lookOf(text: string | null): Look | null {
  const [longitude, latitude, width] = (text ?? "").split(",").map(Number);
  const known = [longitude, latitude, width].every((each) => Number.isFinite(each)) && width! > 0;
  return known ? { longitude: longitude!, latitude: latitude!, width: width! } : null;
}

/** Return the text of a look for the address. */
export function textOf(look: Look): string {
  return [look.longitude.toFixed(2), look.latitude.toFixed(2), look.width.toPrecision(4)].join(",");
}

/** Set a camera for a picture of `width` × `height` pixels of a body with `radius`. */
export function setCamera(camera: OrthographicCamera, look: Look, aspect: number, radius: number): void {
  const half = look.width / 2;
  const [across, up] = aspect > 1 ? [half * aspect, half] : [half, half / aspect];
  Object.assign(camera, { left: -across, right: across, top: up, bottom: -up, near: 0, far: 4 * radius });
  const direction = towards(look.longitude, look.latitude);
  camera.position.copy(direction).multiplyScalar(2 * radius);
  // North is up, at the poles, too.
  camera.up.copy(towards(look.longitude, look.latitude + 90));
  camera.lookAt(0, 0, 0);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
}
