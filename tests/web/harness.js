// Lets a test use the modules of the player in a page; `harness` is there before the page's own scripts.

globalThis.harness = {
  /** Bytes as a data URL, which crosses to the test as text. */
  toText(bytes) {
    return new Promise((resolve) => {
      const reader = new FileReader();
      reader.onload = () => resolve(reader.result);
      reader.readAsDataURL(new Blob([bytes]));
    });
  },

  fromText(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  },

  async openFilm(from, options) {
    const { Film } = await import("/film.js");
    const { openSource } = await import("/source.js");
    return Film.open(await openSource(from), options);
  },

  /** A film in the worker of the player. */
  async openRemote(url) {
    const { RemoteFilm } = await import("/remote_film.js");
    const film = new RemoteFilm();
    await film.open(new URL(url, location.href).href);
    return film;
  },

  /** What a decoder says to bytes: "ok", or the name and the sentence of the error. */
  async verdict(bytes) {
    try {
      const film = await this.openFilm(new Blob([bytes]));
      for (let index = 0; index < film.gops.length; index++) await film.gop(index);
      await film.metadata();
      await film.sounds();
      return ["ok", ""];
    } catch (error) {
      return [error.name, error.message];
    }
  },

  /** Timing and coded values of all GOPs, values as data URLs by the name of the attribute. */
  async values(bytes) {
    const { ATTRIBUTES, SLOTS } = await import("/attributes.js");
    const film = await this.openFilm(new Blob([bytes]));
    const found = [];
    for (let index = 0; index < film.gops.length; index++) {
      const { pts, gaussians, grids } = await film.gop(index);
      const values = {};
      for (const { name, slot, components } of ATTRIBUTES.filter(({ grid }) => grid === "new")) {
        const own = gaussians.filter((_, at) => (
          at % SLOTS >= slot && at % SLOTS < slot + components));
        values[name] = await this.toText(own);
      }
      for (const name of grids ? ["xy", "xt", "yt"] : []) values[name] = await this.toText(grids[name]);
      found.push({ pts: [...pts], values });
    }
    return found;
  },

  /** The whole screen of a stage, RGBA from the top row down. */
  codes(stage) {
    const { width, height } = stage.canvas;
    const upward = stage.renderer.read(0, 0, width, height);
    const codes = new Uint8Array(upward.length);
    for (let row = 0; row < height; row++) {
      codes.set(upward.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    }
    return codes;
  },

  /** Render pictures `[{ time, width, height }]` (ticks after the first) of a film; return data URLs. */
  async render(url, pictures, bits) {
    const { Stage } = await import("/stage.js");
    const { Timeline } = await import("/timeline.js");
    const { Renderer } = await import("/renderer.js");
    const { View } = await import("/view.js");
    const film = await this.openRemote(url);
    let wake = null;
    const stage = new Stage(document.createElement("canvas"), () => wake());
    stage.renderer = new Renderer(stage.canvas, { bits });
    const { width, height } = film.header;
    const camera = { view: (screen) => new View({ coded: [width, height], frame: screen, screen }) };
    stage.load(film, new Timeline(film.header, film.gops), camera);
    const found = [];
    for (const picture of pictures) {
      const options = {
        between: true, layers: "all", outlines: false, ...picture.options,
        screen: [picture.width, picture.height],
      };
      for (;;) {
        const arrival = new Promise((resolve) => { wake = resolve; });
        const state = stage.show(picture.time, options);
        if (state === "fault") throw new Error(stage.fault);
        if (state !== "loading") break;
        await arrival;
      }
      found.push(await this.toText(this.codes(stage)));
    }
    const gl = stage.renderer.gl;
    const error = gl.getError();
    gl.getExtension("WEBGL_lose_context").loseContext();
    film.close();
    return { found, bits: stage.renderer.bits, error };
  },

  /** How often the plates of a film are decoded, and asked for; which GOPs share that of GOP 0. */
  async plates(url) {
    const local = await this.openFilm(new URL(url, location.href).href);
    const { decode } = ImageDecoder.prototype;
    let decoded = 0, asked = 0;
    ImageDecoder.prototype.decode = function (...args) {
      decoded++;
      return decode.apply(this, args);
    };
    const film = await this.openRemote(url), call = film.call.bind(film);
    film.call = (method, ...args) => {
      if (method === "plate") asked++;
      return call(method, ...args);
    };
    const gops = [];
    for (const index of [1, 0, 1, 2]) {
      gops[index] = await film.gop(index);
      await local.gop(index);
    }
    ImageDecoder.prototype.decode = decode;
    film.close();
    return { decoded, asked, shared: gops.map(({ plate }) => plate === gops[0].plate) };
  },

  /** Draw 140 x 100 pixels of the first picture at 482 x 270, from the column 57 of the row 81. */
  async part(url, rotation, mirrored) {
    const { Renderer } = await import("/renderer.js");
    const { View } = await import("/view.js");
    const film = await this.openRemote(url);
    const { width, height } = film.header;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [140, 100];
    const renderer = new Renderer(canvas);
    const view = new View({
      coded: [width, height], frame: [482, 270], left: -57, top: -81, rotation, mirrored,
      screen: [140, 100],
    });
    renderer.clear();
    renderer.draw(renderer.scene(await film.gop(0)), -1, view);
    film.close();
    return this.toText(this.codes({ canvas, renderer }));
  },
};
