// Scratch memory that is kept between calls, so that frames after the first need no allocation.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <new>
#include <vector>

#include "kernels.hpp"

namespace gsvr {

struct Free {
    void operator()(void *p) const { std::free(p); }
};

template <class T>
class Buffer {
   public:
    // Returns memory for n elements, aligned to 64 bytes. When the buffer grows, its contents are
    // lost.
    T *reserve(std::size_t n) {
        if (n > size_) {
            const std::size_t bytes = (n * sizeof(T) + 63) / 64 * 64;
            data_.reset(static_cast<T *>(std::aligned_alloc(64, bytes)));
            size_ = data_ ? n : 0;
            if (!data_) throw std::bad_alloc();
        }
        return data_.get();
    }
    T *get() const { return data_.get(); }

   private:
    std::unique_ptr<T[], Free> data_;
    std::size_t size_ = 0;
};

// The scratch memory of one frame that is being rendered.
struct Workspace {
    Buffer<Splats> splats;
    Buffer<BlockBox> boxes;
    Buffer<Moments> moments;
    Buffer<float> lines, pixels, pictures, static_pictures, plane_gradients, picture_gradients,
        edges;
    Buffer<double> sums;
    Buffer<std::uint8_t> cells, static_cells;
};

// Borrows a workspace for the lifetime of this object; no other object has the same workspace.
class BorrowedWorkspace {
   public:
    BorrowedWorkspace() {
        std::lock_guard<std::mutex> lock(idle().mutex);
        if (idle().spaces.empty()) {
            space_ = std::make_unique<Workspace>();
            idle().spaces.reserve(++idle().made);
        } else {
            space_ = std::move(idle().spaces.back());
            idle().spaces.pop_back();
        }
    }
    ~BorrowedWorkspace() {
        if (!space_) return;
        std::lock_guard<std::mutex> lock(idle().mutex);
        idle().spaces.push_back(std::move(space_));
    }
    BorrowedWorkspace(BorrowedWorkspace &&) = default;
    Workspace &operator*() const { return *space_; }
    Workspace *operator->() const { return space_.get(); }

   private:
    struct Idle {
        std::mutex mutex;
        std::size_t made = 0;
        std::vector<std::unique_ptr<Workspace>> spaces;  // has capacity for all `made` workspaces
    };
    static Idle &idle() {
        static Idle instance;
        return instance;
    }

    std::unique_ptr<Workspace> space_;
};

}  // namespace gsvr
