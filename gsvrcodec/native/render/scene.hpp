// A frame of a model made ready for rendering: time slices, splats, and the levels they are on.
#pragma once

#include "core.hpp"
#include "isa.hpp"
#include "pool.hpp"
#include "workspace.hpp"

namespace gsvr {

// A level of the pyramid, cut into bands that are rasterised one by one.
struct Level {
    Size size;
    int band_rows;

    int bands() const { return (size.height + band_rows - 1) / band_rows; }
    Extent band(int index) const;
    int strips() const { return (size.width + kStripWidth - 1) / kStripWidth; }
    // Floats of a line, of one band and of the whole picture.
    std::size_t line_floats() const { return static_cast<std::size_t>(strips()) * kRowFloats; }
    std::size_t band_floats() const { return line_floats() * band_rows; }
    std::size_t floats() const { return band_floats() * bands(); }
};

// What does not change from frame to frame of one call.
struct Setting {
    // apart: what stands still is drawn before what moves, so that it can be kept.
    Setting(const Model &, Size size, Size coded, bool apart);

    const Model &model;
    const Size size, coded;
    const Kernels &kernels;
    const bool apart;
    Level levels[kLevels];
};

// What stands still, drawn once for all frames: a picture of each level, of those splats alone.
struct Still {
    const float *pictures;  // null: there is none, or too little to be worth it
    int blocks;             // those before this one hold all that moves
    int top;                // the highest level with splats, still or not
};

class Scene {
   public:
    // Memory that frames of a setting need when `bands` threads rasterise one at once.
    static void reserve(const Setting &, int bands, Workspace &);

    // Projects a frame, all of it or what is not in `still`. The workspace must have been reserved.
    Scene(const Setting &, float tau, int threads, Workspace &, const Still &still = {});

    const Frame &frame() const { return frame_; }

    // Draws what stands still, if that is a good part of the frame, and keeps it in the workspace.
    Still keep_still() const;

    // Rasterises band after band and hands each to done(index, rows, pixels).
    template <class Done>
    void render(Done done) const {
        render_levels();
        for_bands([&](int index, Extent rows, const Pixels &pixels) {
            rasterise(0, rows, pixels);
            done(index, rows, pixels);
        });
    }

    // Gradients of all parameters. fill(index, rows, pixels) leaves the gradient of a band's pixels
    // in `pixels`, zero beyond the frame; render_first: it finds the band rasterised there.
    template <class Fill>
    void backward(bool render_first, const Model &gradient, Fill fill) const {
        reserve_backward();
        if (render_first) render_levels();
        for_bands([&](int index, Extent rows, const Pixels &pixels) {
            if (render_first) rasterise(0, rows, pixels);
            fill(index, rows, pixels);
            gather(0, rows, pixels);
        });
        gather_levels();
        backward_deformation(gradient);
    }

   private:
    template <class Body>
    void for_bands(Body body) const {
        const Level &frame = setting_.levels[0];
        parallel_for(frame.bands(), threads_, [&](int index, int worker) {
            const Extent rows = frame.band(index);
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
    void gather_levels() const;
    // Pixels of a whole level in a buffer that holds levels from `first` on.
    Pixels whole(float *pictures, int first, int level) const;
    // Sets a band of a level to what stands still.
    void begin_band(int level, Extent rows, const Pixels &) const;
    // A band of a level, on top of the levels above it.
    void rasterise(int level, Extent rows, const Pixels &) const;
    // Moments of a band's splats, and the next level's gradient.
    void gather(int level, Extent rows, const Pixels &) const;
    void reserve_backward() const;
    void backward_deformation(const Model &gradient) const;

    const Setting &setting_;
    Workspace &space_;
    const int threads_;
    Frame frame_;
    const Still still_;
    Layer layers_[kLayers];
    int top_;  // the highest level with splats
};

}  // namespace gsvr
