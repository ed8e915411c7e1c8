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
    // Rows of a buffer that holds `rows`, whole vectors.
    int padded(int rows) const { return (rows + kernels.rows - 1) / kernels.rows * kernels.rows; }
    int strips() const { return (size.width + kStripWidth - 1) / kStripWidth; }
    std::size_t floats(int rows) const {
        return static_cast<std::size_t>(strips()) * padded(rows) * kRowFloats;
    }
    int scratch_rows() const;
};

class Scene {
   public:
    // Memory that frames of a setting need. `bands`: threads that rasterise into scratch at once.
    static void reserve(const Setting &, int bands, Workspace &);
    static void reserve_backward(const Setting &, Workspace &);

    // Projects a frame. The workspace must have been reserved.
    Scene(const Setting &, float tau, int threads, Workspace &);

    const Frame &frame() const { return frame_; }

    // Rasterises band after band and hands each to done(index, rows, pixels): into `whole`, which
    // holds the whole frame, or when that is null into scratch.
    template <class Done>
    void for_bands(float *whole, Done done) const {
        parallel_for(setting_.bands(), threads_, [&](int index, int worker) {
            const Extent rows = setting_.band(index);
            done(index, rows, rasterise(rows, whole, worker));
        });
    }

    // Gradients of all parameters from the gradient of the whole frame's pixels.
    void backward(float *whole, const Model &gradient) const;

   private:
    Pixels rasterise(Extent rows, float *whole, int worker) const;

    const Setting &setting_;
    Workspace &space_;
    const int threads_;
    Frame frame_;
};

}  // namespace gsvr
