// A frame of a gop made ready for rendering: time slices, splats, and the levels they are on.
#pragma once

#include "core.hpp"
#include "isa.hpp"
#include "pool.hpp"
#include "workspace.hpp"

namespace gsvr {

// A level of the pyramid, cut into bands that are rasterised one by one.
struct PyramidLevel {
    Size size;
    int band_rows;

    int bands() const { return (size.height + band_rows - 1) / band_rows; }
    RowRange band(int index) const;
    int strips() const { return (size.width + kStripWidth - 1) / kStripWidth; }
    // Floats of a line, of one band and of the whole picture.
    std::size_t line_floats() const { return static_cast<std::size_t>(strips()) * kRowFloats; }
    std::size_t band_floats() const { return line_floats() * band_rows; }
    std::size_t floats() const { return band_floats() * bands(); }
};

// What does not change from frame to frame of one call.
struct RenderCall {
    // apart: what stands still is drawn before what moves, so that it can be kept.
    RenderCall(const GopArrays &, Size size, Size coded, bool separate_static);

    const GopArrays &gop;
    const Size size, coded;
    const Kernels &kernels;
    const bool separate_static;
    PyramidLevel levels[kLevels];
};

// What stands still, drawn once for all frames: a picture of each level, of those splats alone.
struct StaticPyramid {
    const float *pictures;  // null: there is none, or too little to be worth it
    int dynamic_blocks;             // those before this one hold all that moves
    int coarsest;                // the highest level with splats, still or not
};

class FrameRenderer {
   public:
    // Memory that frames of a call need when `bands` threads rasterise one at once.
    static void reserve(const RenderCall &, int bands, Workspace &);

    // Projects a frame, all of it or what is not in `still`. The workspace must have been reserved.
    FrameRenderer(const RenderCall &, float tau, int threads, Workspace &, const StaticPyramid &static_pyramid = {});

    const Frame &frame() const { return frame_; }

    // Draws what stands still, if that is a good part of the frame, and keeps it in the workspace.
    StaticPyramid draw_static_pyramid() const;

    // Rasterises band after band and hands each to done(index, rows, pixels).
    template <class Done>
    void render(Done done) const {
        render_levels();
        for_bands([&](int index, RowRange rows, const Pixels &pixels) {
            rasterise_band(0, rows, pixels);
            done(index, rows, pixels);
        });
    }

    // Gradients of all parameters. fill(index, rows, pixels) leaves the gradient of a band's pixels
    // in `pixels`, zero beyond the frame; render_first: it finds the band rasterised there.
    template <class Fill>
    void backward(bool render_first, const GopArrays &gradient, Fill fill) const {
        reserve_backward();
        if (render_first) render_levels();
        for_bands([&](int index, RowRange rows, const Pixels &pixels) {
            if (render_first) rasterise_band(0, rows, pixels);
            fill(index, rows, pixels);
            backward_band(0, rows, pixels);
        });
        backward_levels();
        backward_deformation(gradient);
    }

   private:
    template <class Body>
    void for_bands(Body body) const {
        const PyramidLevel &frame = call_.levels[0];
        parallel_for(frame.bands(), threads_, [&](int index, int worker) {
            const RowRange rows = frame.band(index);
            body(index, rows,
                 Pixels{space_.pixels.get() + worker * frame.band_floats(), rows.begin,
                        frame.band_rows});
        });
    }
    // The whole picture of a level above 0, or its gradient.
    Pixels picture(int level) const;
    Pixels picture_gradient(int level) const;
    // What the bands of a level leave for the next one's rows beside theirs.
    float *edges(int level) const;
    void render_levels() const;
    void backward_levels() const;
    // Pixels of a whole level in a buffer that holds levels from `first` on.
    Pixels level_pixels(float *pictures, int first, int level) const;
    // Sets a band of a level to what stands still.
    void begin_band(int level, RowRange rows, const Pixels &) const;
    // A band of a level, on top of the levels above it.
    void rasterise_band(int level, RowRange rows, const Pixels &) const;
    // Moments of a band's splats, and the next level's gradient.
    void backward_band(int level, RowRange rows, const Pixels &) const;
    void reserve_backward() const;
    void backward_deformation(const GopArrays &gradient) const;

    const RenderCall &call_;
    Workspace &space_;
    const int threads_;
    Frame frame_;
    const StaticPyramid static_pyramid_;
    SplatLayer layers_[kLayers];
    int coarsest_;  // the highest level with splats
};

}  // namespace gsvr
