// A frame of a model made ready for rendering: time slices, splats, bands.
#pragma once

#include "core.hpp"
#include "isa.hpp"
#include "pool.hpp"
#include "workspace.hpp"

namespace gsvr {

// What does not change from frame to frame of one call.
struct Setting {
    const Model &model;
    Size size, coded;
    const Kernels &kernels;

    int blocks() const { return (model.n + kBlock - 1) / kBlock; }
    int bands() const { return (size.height + kernels.band_rows - 1) / kernels.band_rows; }
    Extent band(int index) const;
    int strips() const { return (size.width + kStripWidth - 1) / kStripWidth; }
    // Floats of a buffer for one band.
    std::size_t band_floats() const {
        return static_cast<std::size_t>(strips()) * kernels.band_rows * kRowFloats;
    }
};

class Scene {
   public:
    // Memory that frames of a setting need when `bands` threads rasterise one at once.
    static void reserve(const Setting &, int bands, Workspace &);

    // Projects a frame. The workspace must have been reserved.
    Scene(const Setting &, float tau, int threads, Workspace &);

    const Frame &frame() const { return frame_; }

    // Rasterises band after band and hands each to done(index, rows, pixels).
    template <class Done>
    void render(Done done) const {
        for_bands([&](int index, Extent rows, const Pixels &pixels) {
            rasterise(rows, pixels);
            done(index, rows, pixels);
        });
    }

    // Gradients of all parameters. fill(index, rows, pixels) leaves the gradient of a band's pixels
    // in `pixels`, zero beyond the frame; render_first: it finds the band rasterised there.
    template <class Fill>
    void backward(bool render_first, const Model &gradient, Fill fill) const {
        reserve_backward();
        for_bands([&](int index, Extent rows, const Pixels &pixels) {
            if (render_first) rasterise(rows, pixels);
            fill(index, rows, pixels);
            setting_.kernels.gather(space_.splats.get(), space_.rows.get(), setting_.blocks(), rows,
                                    pixels, space_.moments.get());
        });
        backward_deformation(gradient);
    }

   private:
    template <class Body>
    void for_bands(Body body) const {
        parallel_for(setting_.bands(), threads_, [&](int index, int worker) {
            const Extent rows = setting_.band(index);
            body(index, rows,
                 Pixels{space_.pixels.get() + worker * setting_.band_floats(), rows.begin,
                        setting_.kernels.band_rows});
        });
    }
    void rasterise(Extent rows, const Pixels &) const;
    void reserve_backward() const;
    void backward_deformation(const Model &gradient) const;

    const Setting &setting_;
    Workspace &space_;
    const int threads_;
    Frame frame_;
};

}  // namespace gsvr
